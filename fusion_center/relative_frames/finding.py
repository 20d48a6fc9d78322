"""A frame that is not yet known: searched for at a report event, and perhaps found.

First against the own carrier; where that shares too few targets, against each carrier whose frame
is followed already. Where nobody shares any, what navigation says may be enough (`surveyed`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.relative_frame import (
    OwnAxesFrame,
    PolarLogs,
    RelativeFramePrior,
    in_fixed_axes,
    robust_adjustment,
)
from estimation.relative_frame.joint import composed
from estimation.relative_frame.range_errors import (
    NO_RANGE_ERRORS,
    RangeErrors,
    Seen,
    considered,
    gains,
)
from estimation.relative_frame.situation import reasons

from ..quality import MOST_NIS, Tally
from ..sources.sightings import Pair
from ..sources.telling import telling
from ..state import Estimate, Link, State
from ..state.links import frames_without
from . import base_tracks, corrections, frames, monitor, registration, search, surveyed
from .common import told_by_a_plot
from .corrections import Misclosure
from .moment import Moment
from .monitor import MAX_REASON
from .search import Found
from .views import View

EAGER, PATIENT = 10, 5
"""Searches in vain after which only every so many events are tried."""
NO_GAIN = np.zeros((0, 3, 2))
MAJORITY = 2 / 3
"""Share of pairs that must agree before the others are taken for wrong."""


class Base(NamedTuple):
    """A carrier to search against: what it sees, and what navigation says of the other from it."""

    name: str
    view: View
    prior: RelativeFramePrior


class Start(NamedTuple):
    """A frame found by itself.

    Attributes:
        through: in whose axes `frame` is.
        by_ranges: what `frame` hangs on beside, see `considered`; None = on nothing.
        gain: (L, 3, 2) by what it moves with the place of each pair in these axes.
        estimate: in own axes.
        pairs: behind it; nis: (L,) of each; remark: what their geometry hides.
    """

    through: str
    frame: OwnAxesFrame
    by_ranges: Array | None
    gain: Array
    estimate: Estimate
    pairs: list[Pair]
    nis: Array
    remark: str


def with_search(state: State, moment: Moment, name: str, tally: Tally) -> State:
    """The state after a carrier's frame has been searched for."""
    link: Link = replace(state.links[name], events=state.links[name].events + 1)
    if link.tries >= EAGER and link.events % PATIENT:
        return _with(state, name, link)
    found, start = _tried(state, moment, name)
    if start is None and link.tries + 1 >= EAGER and link.monitor.state == "observing":
        start = _as_navigated(state, moment, name)
    estimate = start.estimate if start else None
    judged, _ = monitor.after_registration(
        link.monitor,
        estimate,
        state.settings.monitor,
        found.sentence[:MAX_REASON],
        start.remark if start else "",
    )
    _count(state, moment, name, start, tally)
    link = replace(link, monitor=judged, estimate=estimate, tries=link.tries + 1)
    if start is None or monitor.is_excessive(start.estimate, state.settings.monitor):
        return _with(state, name, link)
    link = replace(
        link,
        followed=True,
        found_t_ns=moment.t_ns,
        mode_probability=found.probability,
        tries=0,
        doubts=0,
        watch=None,
    )
    known = frames_without(state.frames, name)
    through = start.through, start.by_ranges
    found_from = base_tracks.Pairs(start.through, start.frame, start.pairs, start.gain)
    common = base_tracks.shared_by(state, known, moment, found_from)
    known = frames.joined_by(state, known, name, start.frame, moment.t_ns, through, common)
    return _with(replace(state, frames=known), name, link)


def _as_navigated(state: State, moment: Moment, name: str) -> Start | None:
    """A frame that needs no targets, where none contradict it."""
    known = surveyed.known_beforehand(moment, name)
    if known is None or surveyed.contradicted(state, moment, name):
        return None
    known = corrections.within_bounds(replace(known, since_t_ns=moment.t_ns))
    return Start(state.own, corrections.frame_of(known), None, NO_GAIN, known, [], np.zeros(0), "")


def _tried(state: State, moment: Moment, name: str) -> tuple[Found, Start | None]:
    """What the search against the own carrier came to, or the first that found something better."""
    at_first: tuple[Found, Start | None] | None = None
    for base in _bases(state, moment, name):
        try:
            tried = _against(state, moment, name, base)
        except (np.linalg.LinAlgError, ValueError) as error:
            sentence = f"no frame comes out of these numbers: {error}"
            tried = Found([], 0.0, sentence), None
        at_first = at_first or tried
        if _is_determined(tried[1]):
            return tried
    return at_first or (Found([], 0.0, "nobody to compare with"), None)


def _bases(state: State, moment: Moment, name: str) -> Iterator[Base]:
    """The own carrier, and those that are followed and take part."""
    prior = moment.prior[name]
    yield Base(state.own, moment.own, prior)
    followed = state.frames.carriers if state.frames else ()
    for base in sorted(set(followed) & set(moment.names) - {name}):
        if state.links[base].followed:
            yield Base(base, moment.others[base], _between(moment.prior[base], prior))


def _between(base: RelativeFramePrior, other: RelativeFramePrior) -> RelativeFramePrior:
    """Where another carrier is from the base; the doubt of the own place is in both, and stays."""
    return RelativeFramePrior(
        offset_m=other.offset_m - base.offset_m,
        offset_covariance=base.offset_covariance + other.offset_covariance,
        sigma_c1_rad=base.sigma_c2_rad,
        sigma_c2_rad=other.sigma_c2_rad,
    )


def _is_determined(start: Start | None) -> bool:
    return start is not None and start.estimate.directions[0].status == "determined"


def _against(state: State, moment: Moment, name: str, base: Base) -> tuple[Found, Start | None]:
    """A search against one carrier, and the frame where it comes to one."""
    settings = state.settings.registration
    other, tells = moment.others[name], telling(state)
    found = search.searched(base.view, other, base.prior, state.orders, settings, tells)
    if not found.pairs:
        return found, None
    start = _adjusted(state, moment, name, base, found)
    if monitor.is_excessive(start.estimate, state.settings.monitor):
        logs = _polar(base, moment.others[name], found.pairs)
        kept = robust_adjustment(*logs, base.prior).kept
        if kept.mean() >= MAJORITY:
            right = [pair for pair, stays in zip(found.pairs, kept, strict=True) if stays]
            start = _adjusted(state, moment, name, base, found._replace(pairs=right))
    return found, start


def _adjusted(state: State, moment: Moment, name: str, base: Base, found: Found) -> Start:
    """The frame of these pairs, exactly, and as it is in own axes."""
    other, between = moment.others[name], moment.between[name]
    plot = told_by_a_plot(other)
    seen, nis = registration.register(
        base.view, other, found.pairs, base.prior, between, "adjustment", plot
    )
    seen = corrections.within_bounds(seen)
    estimate = seen
    alone = corrections.frame_of(seen)
    frame, by_ranges, published = _considered(state, moment, name, base, found.pairs, alone)
    mine, theirs = [pair.own for pair in found.pairs], [pair.other for pair in found.pairs]
    gain = gains(alone, base.view.covariance[mine], *_places(other, theirs))
    known = state.frames if base.name != state.own else None
    if known is not None or by_ranges is not None:
        prior = moment.prior[name]
        own = published
        if known is not None:
            own, _, _ = composed(frames.frame_of(known, base.name), published)
        misclosure = Misclosure(seen.pairs, seen.chi2, seen.dof)
        estimate = corrections.estimated(
            own, in_fixed_axes(own, prior), prior, between, misclosure, "joint", plot
        )
    estimate = replace(
        estimate, method="joint", mode_probability=found.probability, since_t_ns=moment.t_ns
    )
    return Start(
        through=base.name,
        frame=frame,
        by_ranges=by_ranges,
        gain=gain,
        estimate=corrections.within_bounds(estimate),
        pairs=found.pairs,
        nis=np.nan_to_num(nis, nan=MOST_NIS).clip(0.0, MOST_NIS),
        remark="; ".join(reasons(*_polar(base, other, found.pairs))),
    )


def _considered(
    state: State, moment: Moment, name: str, base: Base, pairs: list[Pair], frame: OwnAxesFrame
) -> tuple[OwnAxesFrame, Array | None, OwnAxesFrame]:
    """A frame without what range errors leave open, by what it hangs on them, and with it."""
    ranges = [_sought(state, moment, carrier) for carrier in (base.name, name)]
    if all(errors.none for errors in ranges):
        return frame, None, frame
    views = base.view, moment.others[name]
    rows = [pair.own for pair in pairs], [pair.other for pair in pairs]
    mine, theirs = (
        Seen(view.east_north_m[which], view.covariance[which], errors)
        for view, which, errors in zip(views, rows, ranges, strict=True)
    )
    left, by_ranges = considered(frame, mine, theirs)
    whole = left.covariance.copy()
    for errors, by in zip(ranges, np.split(by_ranges, 2, axis=1), strict=True):
        whole += by @ errors.covariance @ by.T
    return left, by_ranges, left._replace(covariance=whole)


def _places(view: View, rows: list[int]) -> tuple[Array, Array]:
    return view.east_north_m[rows], view.covariance[rows]


def _sought(state: State, moment: Moment, name: str) -> RangeErrors:
    """The range errors of a carrier that are states beside its frame."""
    return moment.ranges[name].get(frames.ranging_source(state, name), NO_RANGE_ERRORS)


def _polar(base: Base, other: View, pairs: list[Pair]) -> tuple[PolarLogs, PolarLogs]:
    mine, theirs = [pair.own for pair in pairs], [pair.other for pair in pairs]
    own = base.view
    return (
        PolarLogs.from_east_north(own.east_north_m[mine], own.covariance[mine]),
        PolarLogs.from_east_north(other.east_north_m[theirs], other.covariance[theirs]),
    )


def _count(state: State, moment: Moment, name: str, start: Start | None, tally: Tally) -> None:
    """Tell who was paired with whom."""
    other = moment.others[name]
    if start is None or start.through != state.own:
        tally.registered((state.own, name), moment.own, other, [], np.zeros(0))
    if start is not None:
        view = moment.own if start.through == state.own else moment.others[start.through]
        tally.registered((start.through, name), view, other, start.pairs, start.nis)


def _with(state: State, name: str, link: Link) -> State:
    return replace(state, links={**state.links, name: link})
