"""Bearings alone in whole runs of scenarios/passive.toml: `python -m bench.passive`.

Every seed is a run in process: how the picket's frame is found, and what is told of the targets by
one carrier's bearings and, once the frame is applied, by both carriers' together. Each is played
twice, with the targets' identities and without any. docs/papers/001.md quotes what is printed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, at_least, between, options, report, table, told
from bench.in_process import Played, played
from crossfix.evaluation import FrameError, frame_errors
from estimation.arrays import Array
from estimation.consistency import mean_interval, rms
from estimation.frames import (
    Site,
    rotation_clockwise,
    site_at,
    target_from_source,
    wrap_pi,
    yaw_rad,
)
from schemas.messages import BearingLine, Correction, Navigation, Tracks, TruthCarriers
from sim_world.scenario import Scenario, load_scenario, with_overrides

SCENARIO = Path(__file__).parents[1] / "scenarios" / "passive.toml"
OWN, OTHER = "hunter", "picket"
NAMELESS = {f"carriers.{name}.sensors.sonar.identity_share": 0 for name in (OWN, OTHER)}
FAR = 50.0
"""Chi2 of 2 of a place that is of no target: of two, taken for one."""
KINDS = {
    "uniform": {"constant velocity"},
    "uniform-far": {"constant velocity"},
    "accelerated": {"straight accelerated", "constant acceleration"},
    "curved": {"turn rate"},
    "turning": {"finite turn", "two legs"},
    "turning-back": {"finite turn", "two legs"},
}
"""What each target does; a straight acceleration is also a constant one, a short turn two legs."""


class Judged(NamedTuple):
    """A line that was told, against the truth.

    Attributes:
        t_s: since the start; target: its name; both: whether of both carriers.
        covered: whether the 95 % interval holds the range.
        error_m, nees: of the place, two degrees of freedom; nan where none is told.
        right: whether the motion is the true one.
    """

    t_s: float
    target: str
    both: bool
    status: str
    covered: bool
    error_m: float
    nees: float
    right: bool


class Run(NamedTuple):
    """What is kept of a run: corrections of the picket, and lines."""

    seed: int
    frames: list[FrameError]
    start_ns: int
    lines: list[Judged]

    def last(self, *, both: bool) -> list[Judged]:
        """What was told last of each target."""
        newest = {line.target: line for line in self.lines if line.both == both}
        return list(newest.values())


def run(scenario: Scenario, seed: int) -> Run:
    """One run, each solution judged when it is first told."""
    only = with_overrides(scenario, {"seed": seed})
    said: list[TruthCarriers | Correction] = []
    lines: list[Judged] = []
    seen: set[tuple[str, int]] = set()
    start_ns = -1
    for step in played(only):
        start_ns = step.closed.t_ns if start_ns < 0 else start_ns
        said += [step.carriers, *(c for c in step.corrections.values() if c.own_axes)]
        message = next(out.message for out in step.outputs if isinstance(out.message, Tracks))
        for line in message.lines:
            fresh = line.t_ns == step.closed.t_ns and (line.id, line.t_ns) not in seen
            if fresh and (line.carriers or line.id.startswith(f"{OWN}/")):
                seen.add((line.id, line.t_ns))
                lines.append(_judged(only, step, line, (line.t_ns - start_ns) * 1e-9))
    applied = [e for e in frame_errors(only.declared, OWN, said)[OTHER] if e.state == "applied"]
    return Run(seed, applied, start_ns, lines)


def _judged(scenario: Scenario, step: Played, line: BearingLine, t_s: float) -> Judged:
    """A line of this very step, by where everyone is in the picture."""
    targets, carriers = _in_picture(scenario, step)
    which = _whose(step, line, targets)
    observer = carriers[np.argmin(np.hypot(*(carriers - line.observer_m).T))]
    range_m, error = float(np.hypot(*(targets[which] - observer))), np.full(2, np.nan)
    nees, target = float("nan"), step.targets.identity[which]
    if line.position_m is not None and line.covariance is not None:
        error = line.position_m - targets[which]
        c = line.covariance
        nees = float(error @ np.linalg.solve([[c[0], c[1]], [c[1], c[4]]], error))
    return Judged(
        t_s,
        target,
        bool(line.carriers),
        line.status,
        line.range_low_m <= range_m <= (line.range_high_m or np.inf),
        float(np.hypot(*error)),
        nees,
        line.motion in KINDS[target],
    )


def _whose(step: Played, line: BearingLine, targets: Array) -> int:
    """The target of a line: the one of its name, else the one at its place or on its bearing."""
    name = line.id.rpartition("/")[2]
    if name in step.targets.identity:
        return step.targets.identity.index(name)
    if line.carriers and line.position_m is not None:
        return int(np.argmin(np.hypot(*(targets - line.position_m).T)))
    bearing = np.arctan2(*(targets - line.observer_m).T)
    return int(np.argmin(np.abs(wrap_pi(bearing - line.bearing_rad))))


def _in_picture(scenario: Scenario, step: Played) -> tuple[Array, Array]:
    """Where targets and carriers truly are, as the picture has it: as the own carrier believes."""
    o, own = scenario.declared.origin, step.carriers.carrier.index(OWN)
    origin = Site(o.latitude_rad, o.longitude_rad, o.altitude_m)
    there = site_at(origin, np.array(step.carriers.position_m[own]))
    poses = [m.pose for m in step.said if isinstance(m, Navigation) and m.carrier == OWN]
    reported = Site(poses[-1].latitude_rad, poses[-1].longitude_rad, poses[-1].altitude_m)
    picture_from_own = target_from_source(origin, reported)
    true = yaw_rad(target_from_source(origin, there))
    turn = rotation_clockwise(yaw_rad(picture_from_own) - true - step.carriers.north_error_rad[own])
    believed = picture_from_own.apply(np.zeros(3))[:2]
    targets, carriers = (
        believed + np.subtract(places, step.carriers.position_m[own])[:, :2] @ turn.T
        for places in (step.targets.position_m, step.carriers.position_m)
    )
    return targets, carriers


def figures(seed: int, runs: int) -> tuple[list[Figure], str]:
    """All that is demanded, and a table of the runs."""
    found, tables = list[Figure](), list[str]()
    for when, more in (("", {}), ("no names: ", NAMELESS)):
        scenario = load_scenario(SCENARIO, {"fusion.passive.solve_every_s": 30, **more})
        every = [run(scenario, 1000 * seed + k) for k in range(runs)]
        some = [*_of_frames(every), *_of_lines(every, both=False), *_of_lines(every, both=True)]
        found += [figure._replace(name=f"{when}{figure.name}") for figure in some]
        tables.append(_table(every))
    return found, "\n\n".join(tables)


def _of_frames(every: Sequence[Run]) -> Iterator[Figure]:
    applied = [(r.frames[0].t_ns - r.start_ns) * 1e-9 for r in every if r.frames]
    yield at_least("the picket's correction is applied in", len(applied) / len(every), 1)
    if not applied:
        return
    yield told("applied after, median", float(np.median(applied)), "s")
    yield told("applied after, latest", max(applied), "s")
    last = [r.frames[-1] for r in every if r.frames]
    for name, values, unit in (
        ("place before", [np.hypot(*e.before_m) for e in last], "m"),
        ("place after", [np.hypot(*e.after_m) for e in last], "m"),
        ("place's sigma", [e.sigma_m for e in last], "m"),
        ("north after", [np.degrees(e.after_rad) for e in last], "deg"),
        ("north's sigma", [np.degrees(e.sigma_rad) for e in last], "deg"),
    ):
        yield told(f"{name}, RMS", float(rms(np.array(values))), unit)
    low, high = mean_interval(3, len(last), 0.95)
    framed = [[e.nees / 3 for e in r.frames] for r in every if r.frames]
    for when, values in (
        ("when first applied", [some[0] for some in framed]),
        ("while applied", [float(np.mean(some)) for some in framed]),
        ("at the end", [some[-1] for some in framed]),
    ):
        yield between(f"NEES by its 3 dimensions {when}, mean", float(np.mean(values)), low, high)


def _of_lines(every: Sequence[Run], *, both: bool) -> Iterator[Figure]:
    name = "both carriers' bearings" if both else "own bearings"
    by_run = [[line for line in r.lines if line.both == both] for r in every]
    ranged = [[line for line in some if line.status != "undetermined"] for some in by_run]
    lines, with_range = list(chain(*by_run)), list(chain(*ranged))
    if not with_range:
        return
    yield between(f"{name}: 95 % intervals of a told range cover", _covered(with_range), 0.92, 0.97)
    error = np.std([_covered(some) for some in ranged if some]) / np.sqrt(len(every))
    yield told(f"{name}: the same, standard error over runs", float(error))
    yield told(f"{name}: 95 % intervals cover, open ones too", _covered(lines))
    nees = float(np.nanmedian([line.nees for line in with_range])) / 1.386
    yield told(f"{name}: NEES of 2 of a place, median by chi2's", nees)
    last = [line for r in every for line in r.last(both=both)]
    share = float(np.mean([line.status == "determined" for line in last]))
    yield at_least(f"{name}: determined at the end", share, 0.9)
    errors = [line.error_m for line in last if np.isfinite(line.error_m)]
    yield told(f"{name}: error of places at the end, median", float(np.median(errors)), "m")
    far = float(np.mean([line.nees > FAR for line in with_range]))
    yield told(f"{name}: places where no target is", far)
    wrong = float(np.mean([not line.right for line in last]))
    yield told(f"{name}: another kind of motion at the end", wrong)


def _covered(lines: Sequence[Judged]) -> float:
    return float(np.mean([line.covered for line in lines]))


def _table(every: Sequence[Run]) -> str:
    headings = (
        "seed",
        "applied after, s",
        "place before, m",
        "after",
        "its sigma",
        "north before, deg",
        "after",
        "its sigma",
        "NEES (3)",
        "targets by own bearings, m",
        "by both",
    )
    rows = []
    for r in every:
        if r.frames:
            e = r.frames[-1]
            errors = [
                np.median([line.error_m for line in r.last(both=both)] or [np.nan])
                for both in (False, True)
            ]
            values = (
                (r.frames[0].t_ns - r.start_ns) * 1e-9,
                np.hypot(*e.before_m),
                np.hypot(*e.after_m),
                e.sigma_m,
                np.degrees(e.before_rad),
                np.degrees(e.after_rad),
                np.degrees(e.sigma_rad),
                e.nees,
                *errors,
            )
            rows.append([str(r.seed), *(f"{value:.3g}" for value in values)])
    return table(headings, rows)


def main() -> None:
    """Play, judge, print."""
    given = options("Bearings alone in whole runs.", runs=20)
    found, by_run = figures(given.seed, given.runs)
    if not given.json:
        print(f"{by_run}\n")
    report(found, given)


if __name__ == "__main__":
    main()
