"""Bearings alone: what each target of a passive source may be doing, refreshed as it is seen.

The bearings of a target are kept along the axes of the picture, each from where its carrier was, as
long as the carrier's frame may be used there. Every so often all targets with news are solved anew
together: nothing is carried over from one solution to the next. A range that the bearings do not
determine is never told as a number, only as an interval; once it is determined the target becomes
a track of the picture, which further bearings then improve.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.bearings_only import Bearings, MotionPrior, Solution, bearings, solve_many
from estimation.tracking.imm import combined
from estimation.tracking.seeding import restated, seeded
from schemas.messages import BearingLine, SourceReport

from ..navigation import NS, symmetric
from ..picture.axes import Placed, placed
from ..picture.names import ALIVE
from ..picture.ways import settings_of
from ..settings import PassiveSettings
from ..sources.coordinates import instants_ns
from ..state import Drawn, Line, Notes, State
from ..timeline import Instant
from . import crossing
from .naming import bearings_of, is_nameless, names, target_of
from .telling import described

NO_LINE = Line(t_ns=np.zeros(0, dtype=np.int64), seen=np.zeros((0, 4)))
SEEN_SURELY = 0.99
"""Existence of a track that begins with a solution of many bearings."""
NEAR = 16.0
"""Chi2 of 2 within which a nameless target is the one of a track that stands there."""


def with_bearings(state: State, instant: Instant) -> State:
    """The state with the bearings of one instant in its lines."""
    if not state.settings.passive.enabled:
        return state
    state = crossing.crossed(state, instant)
    for message in instant.messages:
        if isinstance(message, SourceReport) and message.bearing_rad and message.range_m is None:
            with np.errstate(all="ignore"):  # numbers from the wire may be anything in bounds
                axes = placed(state, message.carrier, message.t_ns)
                if axes is not None:
                    state = _with_report(state, message, axes)
    return state


def _with_report(state: State, report: SourceReport, axes: Placed) -> State:
    """The newest bearing of every target that the report names."""
    lines = dict(state.lines)
    bearing, sigma = bearings_of(state, report)
    bearing = bearing + axes.turn_rad
    at_ns, here = instants_ns(report), axes.place_m()
    for i, target in enumerate(names(state, report)):
        if target and np.isfinite(bearing[i] + sigma[i]):
            key = f"{report.carrier}/{report.stream}/{target.partition('/')[2]}"
            row = np.array([[*here, bearing[i], sigma[i]]])
            before = lines.get(key) or NO_LINE
            longer = _longer(before, int(at_ns[i]), row, state.settings.passive)
            lines[key] = replace(longer, identity=target)
    kept = _bounded(lines, state.settings.passive.most_targets)
    return _seeded(_solved(replace(state, lines=kept), report.t_ns), report.t_ns)


def _longer(line: Line, t_ns: int, row: Array, settings: PassiveSettings) -> Line:
    """A line with one bearing more, without those that are too old; one of an instant is enough."""
    if len(line.t_ns) and t_ns <= line.t_ns[-1]:
        return line
    kept = line.t_ns >= t_ns - round(settings.memory_s * 1e9)
    times = np.append(line.t_ns[kept], np.int64(t_ns))[-settings.most_bearings :]
    seen = np.concatenate([line.seen[kept], row])[-settings.most_bearings :]
    return replace(line, t_ns=times, seen=seen)


def _bounded(lines: dict[str, Line], most: int) -> dict[str, Line]:
    """At most so many targets, those that were seen last."""
    if len(lines) <= most:
        return lines
    newest = sorted(lines, key=lambda key: (-int(lines[key].t_ns[-1]), key))[:most]
    return {key: lines[key] for key in sorted(newest)}


def _solved(state: State, t_ns: int) -> State:
    """The state with every line solved anew that has news and has waited long enough."""
    settings, lines = state.settings.passive, dict(state.lines)
    together = crossing.shown(state, t_ns)
    due = [
        key
        for key, line in sorted(lines.items())
        if _common_name(state, key, line) not in together
        and len(line.t_ns) >= settings.least_bearings
        and line.t_ns[-1] > line.solved_t_ns
        and (line.tried_t_ns < 0 or t_ns - line.tried_t_ns >= round(settings.solve_every_s * 1e9))
    ]
    due.sort(key=lambda key: len(lines[key].t_ns))
    for count, some in groupby(due, key=lambda key: len(lines[key].t_ns)):
        group = list(some)
        for key, solution in zip(group, _solutions([lines[key] for key in group]), strict=True):
            line = lines[key]
            told = _told(key, line, solution, count)
            newest = int(line.t_ns[-1])
            lines[key] = replace(line, told=told, solved_t_ns=newest, tried_t_ns=t_ns)
    return replace(state, lines=lines)


def _seeded(state: State, t_ns: int) -> State:
    """The state with a track of every target whose range has just been found to be known.

    As long as none but those whose bearings it has see the target, its track is what the newest
    solution says: that rests on all bearings at once, the filter of the picture on one after
    another.
    """
    drawn = state.picture
    if drawn.picture is None or not state.settings.picture.enabled:
        return state
    known = {note.identity or note.line: n for n, note in drawn.notes.items()}
    for key, line in (*state.lines.items(), *state.crossed.items()):
        told = line.told
        if told is None or line.tried_t_ns != t_ns or told.status != "determined":
            continue
        name = _common_name(state, key, line)
        number = known.get(name)
        if number is None and is_nameless(line.identity):
            number = _standing_there(drawn, told)
        if number is None or _is_alone(drawn.notes.get(number, Notes()), key, told.carriers):
            note = Notes(line=name) if is_nameless(line.identity) else Notes(identity=name)
            drawn = _with_track(state, drawn, number, note, told)
    return state if drawn is state.picture else replace(state, picture=drawn)


def _common_name(state: State, key: str, line: Line) -> str:
    """What all carriers call the target of a line of one of them, or of several."""
    crosses = line.told is not None and line.told.carriers
    return line.identity if crosses else target_of(state, key.partition("/")[0], line.identity)


def _standing_there(drawn: Drawn, told: BearingLine) -> str | None:
    """The track that is where a nameless target is: it may be known to others already."""
    if drawn.picture is None or told.position_m is None or not len(drawn.picture.tracks.identity):
        return None
    tracks = drawn.picture.tracks
    late_s = (drawn.picture.t_ns - told.t_ns) * NS
    place = np.add(told.position_m, late_s * np.array(told.velocity_mps))
    mean, covariance = combined(tracks.bank)
    spread = np.moveaxis(covariance[:2, :2], 2, 0) + symmetric(told.covariance or (), 4)[:2, :2]
    apart = mean[:2].T - place
    chi2 = np.einsum("ni,ni->n", apart, np.linalg.solve(spread, apart[..., None])[..., 0])
    chi2 = np.where(tracks.existence > ALIVE, chi2, np.inf)
    nearest = int(np.argmin(chi2))
    return str(tracks.identity[nearest]) if chi2[nearest] < NEAR else None


def _is_alone(notes: Notes, key: str, carriers: Sequence[str]) -> bool:
    """Whether a track rests on this source, or on these carriers, only."""
    if carriers:
        return {source.partition("/")[0] for source in notes.logs} <= set(carriers)
    return set(notes.logs) <= {key.rpartition("/")[0]}


def _with_track(
    state: State, drawn: Drawn, number: str | None, note: Notes, told: BearingLine
) -> Drawn:
    """The picture with a track where a solution has its target, new or told anew."""
    if drawn.picture is None or told.position_m is None or told.velocity_mps is None:
        return drawn
    late_s = (drawn.picture.t_ns - told.t_ns) * NS
    mean = np.array([*told.position_m, *told.velocity_mps])
    mean[:2] += late_s * mean[2:]
    covariance = symmetric(told.covariance or (), 4)
    if number is not None:
        return replace(drawn, picture=restated(drawn.picture, int(number), mean, covariance))
    notes = {**drawn.notes, str(drawn.picture.begun): note}
    picture = seeded(drawn.picture, mean, covariance, SEEN_SURELY, settings_of(state))
    return replace(drawn, picture=picture, notes=notes)


def _solutions(lines: Sequence[Line]) -> list[Solution]:
    """Of targets with as many bearings each."""
    first = min(int(line.t_ns[0]) for line in lines)
    at_s = np.array([np.multiply(line.t_ns - first, NS) for line in lines])
    seen = np.array([line.seen for line in lines])
    given: Bearings = bearings(at_s, seen[..., :2], seen[..., 2], seen[..., 3])
    return solve_many(given, MotionPrior())


def _told(key: str, line: Line, solution: Solution, count: int) -> BearingLine | None:
    """A solution as it is published; None where not even a line comes of it."""
    of_sight = solution.line
    if of_sight is None or not np.isfinite(of_sight.covariance).all():
        return None
    east, north, _, sigma = line.seen[-1].tolist()
    told = BearingLine(
        id=key,
        status=solution.status,
        t_ns=int(line.t_ns[-1]),
        observer_m=[east, north],
        bearing_rad=float(np.mod(of_sight.bearing_rad, 2 * np.pi)),
        sigma_bearing_rad=float(np.sqrt(max(of_sight.covariance[0, 0], 0.0))) or sigma,
        bearing_rate_rad_s=float(of_sight.bearing_rate_rad_s),
        range_rate_by_range_hz=float(of_sight.range_rate_over_range),
    )
    return described(told, solution, count)


def lines(state: State, t_ns: int) -> list[BearingLine]:
    """What is told of the bearings at a closing, while they are not too old.

    A target that several carriers see together has one line.
    """
    oldest = t_ns - round(state.settings.passive.shown_s * 1e9)
    together = crossing.shown(state, t_ns)
    told = (
        line.told
        for key, line in sorted(state.lines.items())
        if _common_name(state, key, line) not in together
    )
    alone = [line for line in told if line is not None and line.t_ns >= oldest]
    return alone + [line for _, line in sorted(together.items())]
