"""The whole fusion centre where no target says who it is: scenarios/no_identities.toml, many seeds.

One instant each: that at which a carrier's frame is first found. It is judged against the truth,
and against the frame that the right pairs of the very same tracks would have given. A share of the
runs goes on for a minute: frames that are followed must come out better, and stay honest.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.figures import Figure, at_least, at_most, between, told
from bench.in_process import Played, played
from crossfix.evaluation import true_frame
from estimation.arrays import Array
from estimation.consistency import mean_interval, nees
from estimation.frames import rotation_clockwise, wrap_pi
from fusion_center.relative_frames import corrections, registration
from fusion_center.relative_frames.links import navigated
from fusion_center.relative_frames.views import View, in_own_plane, view
from fusion_center.sources.sightings import Pair
from fusion_center.state import Estimate, State
from schemas.messages import TruthCarriers, TruthTargets
from sim_world.scenario import Scenario, load_scenario, with_overrides
from sim_world.scenario.declared import origin_of

SCENARIO = Path(__file__).parents[2] / "scenarios" / "no_identities.toml"
STEPS, EARLY, MINUTE = 20, 6, 60
NEAR_M = 1500.0
"""A track further than this from every target is of none."""


class Found(NamedTuple):
    """A frame at the event at which it was found.

    Attributes:
        step: of the run; probability: of the association it rests on.
        pairs: used; right: of these, how many are of one target.
        error: (3,) of (q, D); covariance: (3, 3) as claimed.
        known: (3,) error with the right pairs of the same tracks.
    """

    carrier: str
    step: int
    probability: float
    pairs: int
    right: int
    error: Array
    covariance: Array
    known: Array


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """What is demanded of the scenario without identities."""
    count = max(runs // 160, 8)
    found, asked = [], 0
    for number in range(count):
        scenario = with_overrides(load_scenario(SCENARIO), {"seed": 1000 * seed + number})
        found += first_found(scenario)
        asked += len(scenario.declared.carriers) - 1
    low, high = mean_interval(3, len(found), 0.99)
    error, known = (np.array([getattr(f, name) for f in found]) for name in ("error", "known"))
    scores = [float(nees(f.error, f.covariance)) / 3 for f in found]
    gross = np.mean([nees(f.error, f.covariance) > 50 for f in found])
    name = "no identities, whole system"
    yield told(f"{name}: frames", len(found))
    yield at_least(f"{name}: carriers found within {STEPS} s", len(found) / asked, 1.0)
    yield at_least(f"{name}: share of right pairs", _share(found), 0.985)
    yield at_least(f"{name}: least probability acted upon", min(f.probability for f in found), 0.99)
    yield at_most(f"{name}: gross errors", float(gross), 0.005)
    ratio = _rms(error[:, :2]) / _rms(known[:, :2])
    yield at_most(f"{name}: error by that of known association", ratio, 1.1)
    yield between(f"{name}: NEES/3", float(np.mean(scores)), low, high)
    yield told(f"{name}: location error", _rms(error[:, :2]), "m")
    yield told(f"{name}: median step of finding", float(np.median([f.step for f in found])))
    yield from _followed(seed, max(count // 10, 2), name)


def _followed(seed: int, count: int, name: str) -> Iterator[Figure]:
    """Frames after a minute, against those just found."""
    early, late = [], []
    for number in range(count):
        scenario = with_overrides(load_scenario(SCENARIO), {"seed": 1000 * seed + 500 + number})
        for now in played(scenario, steps=MINUTE):
            if now.closed.step in (EARLY, MINUTE):
                (early if now.closed.step == EARLY else late).extend(_frames(scenario, now))
    low, high = mean_interval(3, len(late), 0.99)
    yield at_least(f"{name}: applied after a minute", _applied(late) / (2 * count), 1.0)
    yield between(f"{name}: NEES/3 after a minute", _nees(late), low, high)
    errors = [_rms(np.array([f.error[:2] for f in frames])) for frames in (early, late)]
    yield told(f"{name}: location error after {EARLY} s", errors[0], "m")
    yield told(f"{name}: location error after a minute", errors[1], "m")
    yield at_most(
        f"{name}: error after a minute by that after {EARLY} s", errors[1] / errors[0], 0.7
    )


class Followed(NamedTuple):
    """A frame in the middle of a run."""

    state: str
    error: Array
    covariance: Array


def _frames(scenario: Scenario, now: Played) -> Iterator[Followed]:
    """Every frame that is known at a step."""
    for name, link in now.state.links.items():
        if link.estimate is not None:
            error = _error(scenario, now.carriers, now.state, name, link.estimate)
            covariance = corrections.frame_of(link.estimate).covariance
            yield Followed(link.monitor.state, error, covariance)


def _applied(frames: list[Followed]) -> int:
    return sum(f.state == "applied" for f in frames)


def _nees(frames: list[Followed]) -> float:
    return float(np.mean([nees(f.error, f.covariance) for f in frames])) / 3


def first_found(scenario: Scenario, steps: int = STEPS) -> list[Found]:
    """Every carrier's frame at the event at which it was first found, if it was."""
    found: dict[str, Found] = {}
    others = [c.name for c in scenario.declared.carriers[1:]]
    for now in played(scenario, steps=steps):
        for name in others:
            link = now.state.links[name]
            if name not in found and link.followed and link.estimate is not None:
                found[name] = _judged(scenario, now, name, link.estimate)
        if len(found) == len(others):
            break
    return list(found.values())


def _judged(scenario: Scenario, now: Played, name: str, estimate: Estimate) -> Found:
    state, t_ns = now.state, estimate.valid_t_ns
    between, prior = navigated(state, name, t_ns)
    own = in_own_plane(view(state, state.own, t_ns), None)
    other = in_own_plane(view(state, name, t_ns), between)
    mine = targets_of(scenario, now, state.own, own.east_north_m)
    theirs = targets_of(scenario, now, name, view(state, name, t_ns).east_north_m)
    where = {target: j for j, target in enumerate(theirs) if target >= 0}
    pairs = [Pair(i, where[t], "identity") for i, t in enumerate(mine) if t in where]
    known, _ = registration.register(own, other, pairs, prior, between, "adjustment")
    return Found(
        carrier=name,
        step=now.closed.step,
        probability=estimate.mode_probability,
        pairs=estimate.pairs,
        right=_right(now, own, other, mine, theirs, name),
        error=_error(scenario, now.carriers, state, name, estimate),
        covariance=corrections.frame_of(estimate).covariance,
        known=_error(scenario, now.carriers, state, name, known),
    )


def _right(
    now: Played, own: View, other: View, mine: NDArray[np.intp], theirs: NDArray[np.intp], name: str
) -> int:
    """How many of the published pairs of two carriers are of one target."""
    target = {log: int(t) for log, t in zip(own.log, mine, strict=True)}
    target |= {log: int(t) for log, t in zip(other.log, theirs, strict=True)}
    (association,) = (out.message for out in now.outputs if hasattr(out.message, "alone"))
    return sum(
        target.get(logs[0], -1) == target.get(log, -2)
        for logs in (associated.logs for associated in association.targets)
        for log in logs[1:]
        if log.startswith(f"{name}/")
    )


def targets_of(scenario: Scenario, now: Played, name: str, east_north_m: Array) -> NDArray[np.intp]:
    """Which target (n,) each track is of, -1 = none: the nearest, one track to a target."""
    k = now.carriers.carrier.index(name)
    turned = east_north_m @ rotation_clockwise(now.carriers.north_error_rad[k]).T
    place = turned + now.carriers.position_m[k][:2]
    apart = np.linalg.norm(place[:, None] - _places(now.targets)[None], axis=2)
    nearest = apart.argmin(axis=1)
    distance = apart.min(axis=1)
    taken = np.full(len(place), -1, dtype=np.intp)
    for i in np.argsort(distance):
        if distance[i] < NEAR_M and nearest[i] not in taken:
            taken[i] = nearest[i]
    return taken


def _places(targets: TruthTargets) -> Array:
    return np.array(targets.position_m)[:, :2]


def _error(
    scenario: Scenario, truth: TruthCarriers, state: State, name: str, estimate: Estimate
) -> Array:
    """(q, D) less the truth."""
    poses = (estimate.own_pose, estimate.other_pose)
    origin = origin_of(scenario.file)
    true = true_frame(origin, truth, state.own, name, poses, estimate.valid_t_ns)
    frame = corrections.frame_of(estimate)
    turn = float(wrap_pi(float(frame.D_rad) - true.rotation_rad))
    return np.append(frame.q_m - true.place_m, turn)


def _share(found: list[Found]) -> float:
    return sum(f.right for f in found) / sum(f.pairs for f in found)


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.square(errors).sum(axis=1).mean()))
