"""The picture: every report of a carrier whose frame may be used improves the common tracks.

The own carrier's reports always count; another's only while its correction is applied, with all
that the correction leaves unsure (`Scan.common`). No report waits for another: each is taken at its
own instant, and the picture leaves with the Closed that ended its time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace

from estimation.tracking import tracker
from estimation.tracking.bernoulli import PairTerm
from estimation.tracking.tracker import Association, Picture
from schemas.messages import Input, SourceProperties, SourceReport

from ..navigation import NS
from ..quality import Look, Tally
from ..sources.features import CLASS, NOTHING_LEARNED, reports
from ..state import Learned, Notes, State, Watched, Word
from ..timeline import Instant
from . import learning, names
from .axes import placed
from .classes import classes_of, named_classes
from .scans import Plots, plots, told_key
from .watch import flags, look, names_are_believed, watched
from .ways import settings_of

MINE = 0.5
"""Probability from which a log is said to be of a track."""


def with_reports(
    state: State, instant: Instant, tally_of: Callable[[Input], Tally] = lambda message: Tally()
) -> State:
    """The state with the reports of one instant in its picture.

    Args:
        tally_of: where a message is counted.
    """
    if not state.settings.picture.enabled:
        return state
    for message in instant.messages:
        if isinstance(message, SourceReport):
            state = _with_report(state, message, tally_of(message))
    return state


@np.errstate(all="ignore")  # numbers from the wire may be anything within its bounds
def _with_report(state: State, report: SourceReport, tally: Tally) -> State:
    state = learning.with_dictionary(state)
    axes = placed(state, report.carrier, report.t_ns)
    seen = plots(state, report, axes) if axes else None
    if seen is None:
        return state
    settings = settings_of(state)
    before = state.picture.picture or tracker.nothing(settings, report.t_ns)
    seen = _not_before(seen, before.t_ns)
    calls = _calls(state, report, seen, before)
    try:
        after, done = tracker.step(before, seen.scan, settings, calls.term())
    except (np.linalg.LinAlgError, ValueError):
        tally.unpictured(report)
        return state
    after = _sane(after)
    notes = _noted(state, report, seen, calls, done)
    alive = {str(number) for number in after.tracks.identity.tolist()}
    kept = {number: note for number, note in notes.items() if number in alive}
    told = {} if seen.told is None else {told_key(state, report): seen.told}
    agreed = names.agreement(calls.of_track, calls.of_plot, before, done)
    counts = _watched(state, report, look(done, _dimensions(state, report)), agreed, tally)
    learned = _learned(state, report, seen, (before, done), tally)
    drawn = replace(
        state.picture,
        picture=after,
        notes=kept,
        told=_of_the_living(state, {**state.picture.told, **told}),
        watched=_of_the_living(state, {**state.picture.watched, **counts}),
        learned=_of_the_living(state, {**state.picture.learned, **learned}),
    )
    return replace(state, picture=drawn)


def _of_the_living(state: State, by_source: dict[str, Any]) -> dict[str, Any]:
    """What is remembered of sources, without earlier lives of their carriers."""
    alive = {f"{name}/{carrier.boot}" for name, carrier in state.carriers.items()}
    return {key: value for key, value in by_source.items() if key.rpartition("/")[0] in alive}


def _learned(
    state: State, report: SourceReport, seen: Plots, met: tuple[Picture, Association], tally: Tally
) -> dict[str, Learned]:
    """What is known of the features of a source after one more report, counted and told.

    Args:
        met: the picture before, and what its tracks had to do with the report.
    """
    settings, key = state.settings.features, told_key(state, report)
    source = state.sources(report.carrier).get(report.stream, SourceProperties())
    classes, told = classes_of(state.scenario), source.features.get(CLASS)
    named = named_classes(report, seen.log, classes, told)
    if not (settings.enabled and settings.learn) or (seen.heard is None and named is None):
        return {}
    now = state.picture.learned.get(key, NOTHING_LEARNED)
    known, most = state.picture.dictionary, settings.most_pairs
    if named is not None and told is not None and seen.scan.evidence is not None:
        so_far = reports(now, Word(CLASS, classes), told)
        evidence = seen.scan.evidence
        now = learning.taught_classes(now, met[0], evidence, named, met[1], so_far, most)
    if seen.heard is not None:
        now = learning.taught(now, met[0], seen.heard, met[1], known, source, most)
    found = learning.quality(now, source)
    tally.learned(report, found, learning.flags(found))
    return {key: now}


def _watched(
    state: State, report: SourceReport, seen: Look, agreed: names.Agreement, tally: Tally
) -> dict[str, Watched]:
    """How a source agrees with the picture after one more report, counted and told."""
    properties = state.sources(report.carrier).get(report.stream, SourceProperties())
    key = told_key(state, report)
    now = watched(state.picture.watched.get(key, Watched()), seen, agreed)
    false = properties.clutter_per_scan + state.settings.tracking.clutter_per_scan
    tally.pictured(report, seen, flags(now, false))
    return {key: now}


def _dimensions(state: State, report: SourceReport) -> int:
    """Of one plot of a source."""
    properties = state.sources(report.carrier).get(report.stream, SourceProperties())
    return 1 if properties.coordinates == "bearing" else 2


def _sane(picture: Picture) -> Picture:
    """The picture without tracks whose numbers are none."""
    bank = picture.tracks.bank
    finite = np.isfinite(bank.mean).all(axis=(0, 1)) & np.isfinite(bank.model).all(axis=0)
    finite &= np.isfinite(bank.covariance).all(axis=(0, 1, 2))
    finite &= np.isfinite(bank.shared).all(axis=(0, 1, 2))
    finite &= np.isfinite(picture.tracks.existence)
    for part in (*picture.tracks.features, picture.tracks.aside):
        finite &= np.isfinite(part).all(axis=0)
    if finite.all():
        return picture
    return picture._replace(tracks=picture.tracks.take(np.flatnonzero(finite)))


def _not_before(seen: Plots, t_ns: int) -> Plots:
    """Plots older than the picture are carried on to it by the velocity of their tracks."""
    late_s = (t_ns - seen.scan.t_ns) * NS
    if late_s <= 0:
        return seen
    measured = seen.scan.plots
    shifted = measured._replace(offset_s=measured.offset_s - late_s)  # type: ignore[attr-defined]
    return seen._replace(scan=seen.scan._replace(t_ns=t_ns, plots=shifted))


class _Calls(NamedTuple):
    """Names (m,) of plots and (n,) of tracks, and whether those of the source are believed."""

    of_plot: names.Names
    of_track: names.Names
    trusted: bool

    def term(self) -> PairTerm | None:
        return names.pair_term(self.of_track, self.of_plot) if self.trusted else None


def _calls(state: State, report: SourceReport, seen: Plots, before: Picture) -> _Calls:
    """What the plots of a report are called, and the tracks before it."""
    count = state.picture.watched.get(told_key(state, report), Watched())
    of_plot, of_track = names.told(report, seen.log), np.empty(0, dtype=object)
    if of_plot.any():
        of_track = names.borne(state.picture.notes, before)
    return _Calls(of_plot, of_track, names_are_believed(count))


def _noted(
    state: State, report: SourceReport, seen: Plots, calls: _Calls, done: Association
) -> dict[str, Notes]:
    """Which names and logs stand behind each track."""
    notes = dict(state.picture.notes)
    source = f"{report.carrier}/{report.stream}"
    boot = state.carriers[report.carrier].boot
    for number, plot in _taken(done):
        track = str(number)
        before = notes.get(track, Notes())
        log = f"{report.carrier}/{boot}/{report.stream}/{report.seq}/{seen.log[plot]}"
        identity = names.kept(before.identity, calls.of_plot[plot], calls.trusted)
        notes[track] = replace(before, identity=identity, logs={**before.logs, source: log})
    return notes


def _taken(done: Association) -> Iterable[tuple[int, int]]:
    """Track and plot of all that are taken for each other, and of the tracks that were begun."""
    sure = np.flatnonzero(done.probability > MINE)
    yield from zip(done.identity[sure].tolist(), done.plot[sure].tolist(), strict=True)
    begun = np.flatnonzero(done.begun >= 0)
    taken = set(done.plot[sure].tolist())
    yield from ((int(done.begun[p]), p) for p in begun.tolist() if p not in taken)
