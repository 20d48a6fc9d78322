"""Corrections against the truth in the same recording: errors before and after, sigma, NEES."""

from __future__ import annotations

from bisect import bisect_right, insort
from collections import defaultdict
from collections.abc import Iterable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from estimation.frames import (
    Site,
    rotation_clockwise,
    site_at,
    target_from_source,
    wrap_pi,
    yaw_rad,
)
from fusion_center.navigation import pose_at
from schemas.messages import (
    Correction,
    DeclaredScenario,
    Navigation,
    OwnAxes,
    Pose,
    TruthCarriers,
)


class FrameError(NamedTuple):
    """One correction against the truth.

    Attributes:
        before_m, after_m: (east, north) error of the other carrier's place in own axes.
        before_rad, after_rad: error of its orientation.
        fixed_before_m, fixed_after_m: of its place in axes fixed to true north.
        sigma_m: claimed for the place, root of the summed variances; sigma_rad: for orientation.
        nees: of (east, north, orientation), three degrees of freedom.
    """

    step: int
    t_ns: int
    state: str
    pairs: int
    before_m: tuple[float, float]
    after_m: tuple[float, float]
    before_rad: float
    after_rad: float
    fixed_before_m: tuple[float, float]
    fixed_after_m: tuple[float, float]
    sigma_m: float
    sigma_rad: float
    nees: float


class FrameSummary(NamedTuple):
    """Root mean squares over the second half of a run, when it has converged.

    Attributes:
        said_m: of the place in own axes that the carrier reports of itself while it applies its
            corrections; nan where it applies none.
    """

    carrier: str
    state: str
    reason: str
    corrections: int
    before_m: float
    after_m: float
    before_rad: float
    after_rad: float
    fixed_before_m: float
    fixed_after_m: float
    sigma_m: float
    sigma_rad: float
    nees: float
    pairs: float
    said_m: float = float("nan")


class TrueFrame(NamedTuple):
    """Where another carrier is in own sensor axes, and how its bearings are turned, in truth."""

    place_m: np.ndarray
    fixed_place_m: np.ndarray
    rotation_rad: float


def frame_errors(
    scenario: DeclaredScenario, own: str, messages: Iterable[TruthCarriers | Correction]
) -> dict[str, list[FrameError]]:
    """Error of every correction that says something, by carrier, in order.

    A publisher from outside is not in the truth: nobody knows its errors.
    """
    truths: list[TruthCarriers] = []
    errors: dict[str, list[FrameError]] = defaultdict(list)
    origin = Site(*(getattr(scenario.origin, name) for name in scenario.origin.__struct_fields__))
    for message in messages:
        if isinstance(message, TruthCarriers):
            insort(truths, message, key=_time)
        elif message.own_axes and truths:
            truth = truths[max(0, bisect_right(truths, message.valid_t_ns, key=_time) - 1)]
            if message.carrier in truth.carrier:
                error = _error(origin, own, truth, message, message.own_axes)
                errors[message.carrier].append(error)
    return dict(errors)


def said_errors(
    scenario: DeclaredScenario, own: str, messages: Iterable[TruthCarriers | Navigation]
) -> dict[str, list[float]]:
    """How far off each carrier is, in own axes, by what it says while it applies corrections [m].

    Args:
        messages: of truth and of navigation, each in order of time.
    """
    truths: list[TruthCarriers] = []
    poses: list[Navigation] = []
    said: list[Navigation] = []
    for message in messages:
        if isinstance(message, TruthCarriers):
            truths.append(message)
        elif message.carrier == own:
            poses.append(message)
        elif message.correction_id:
            said.append(message)
    origin = Site(*(getattr(scenario.origin, name) for name in scenario.origin.__struct_fields__))
    errors: dict[str, list[float]] = defaultdict(list)
    for message in said:
        after = bisect_right(truths, message.t_ns, key=_time)
        own_pose = reported_at(poses, message.t_ns)
        if after and own_pose and message.carrier in truths[after - 1].carrier:
            pair = own_pose, message.pose
            truth = truths[after - 1]
            true = true_frame(origin, truth, own, message.carrier, pair, message.t_ns)
            seen = target_from_source(_site(pair[0]), _site(pair[1])).translation_m[:2]
            errors[message.carrier].append(float(np.hypot(*(seen - true.place_m))))
    return dict(errors)


def true_frame(
    origin: Site,
    truth: TruthCarriers,
    own: str,
    other: str,
    reported: tuple[Pose, Pose],
    t_ns: int,
    by_sensors: bool = True,
) -> TrueFrame:
    """The truth that a correction with these reported poses estimates.

    Args:
        truth: the last step before the instant `t_ns` of the estimate.
        by_sensors: what sensors add to all their bearings is in the frames, and not told apart.

    The rotation is what is left after the known difference of the norths at the two *reported*
    places, as the correction has it.
    """
    own_index, other_index = truth.carrier.index(own), truth.carrier.index(other)
    own_site = site_at(origin, place_at(truth, own_index, t_ns))
    other_site = site_at(origin, place_at(truth, other_index, t_ns))
    own_from_other = target_from_source(own_site, other_site)
    fixed = own_from_other.translation_m[:2]
    norths = truth.north_error_rad if not by_sensors else sensor_norths_rad(truth)
    c1, c2 = norths[own_index], norths[other_index]
    known = yaw_rad(target_from_source(_site(reported[0]), _site(reported[1])))
    rotation = c2 - c1 + yaw_rad(own_from_other) - known
    return TrueFrame(rotation_clockwise(-c1) @ fixed, fixed, float(wrap_pi(rotation)))


def sensor_norths_rad(truth: TruthCarriers) -> list[float]:
    """Bearing of the north of each carrier's first sensor, clockwise from true north."""
    added = truth.azimuth_bias_rad or [0.0] * len(truth.carrier)
    return [north - bias for north, bias in zip(truth.north_error_rad, added, strict=True)]


def summarise(
    carrier: str, errors: Sequence[FrameError], last: Correction, said_m: Sequence[float] = ()
) -> FrameSummary:
    """Root mean squares over the second half of the errors; nan where there are none.

    Args:
        said_m: of the carrier, see `said_errors`.
    """
    late = errors[len(errors) // 2 :]
    return FrameSummary(
        carrier=carrier,
        state=last.state,
        reason=last.reason,
        corrections=len(late),
        before_m=_rms([e.before_m for e in late]),
        after_m=_rms([e.after_m for e in late]),
        before_rad=_rms([(e.before_rad,) for e in late]),
        after_rad=_rms([(e.after_rad,) for e in late]),
        fixed_before_m=_rms([e.fixed_before_m for e in late]),
        fixed_after_m=_rms([e.fixed_after_m for e in late]),
        sigma_m=_rms([(e.sigma_m,) for e in late]),
        sigma_rad=_rms([(e.sigma_rad,) for e in late]),
        nees=float(np.mean([e.nees for e in late])) if late else float("nan"),
        pairs=float(np.mean([e.pairs for e in late])) if late else float("nan"),
        said_m=_rms([(error,) for error in said_m[len(said_m) // 2 :]]),
    )


def symmetric(triangle: Sequence[float]) -> np.ndarray:
    """The symmetric matrix (n, n) of a row-major upper triangle."""
    matrix: np.ndarray = np.asarray(triangle, dtype=float)[_of_triangle(len(triangle))]
    return matrix


@cache
def _of_triangle(count: int) -> np.ndarray:
    """Where in an upper triangle of so many numbers each element of its matrix stands."""
    order = int(((8 * count + 1) ** 0.5 - 1) / 2)
    where = np.zeros((order, order), dtype=int)
    rows, columns = np.triu_indices(order)
    where[rows, columns] = where[columns, rows] = np.arange(count)
    return where


def _error(
    origin: Site, own: str, truth: TruthCarriers, correction: Correction, axes: OwnAxes
) -> FrameError:
    assert correction.own_pose is not None  # noqa: S101 (comes with own_axes)
    assert correction.other_pose is not None  # noqa: S101
    poses = (correction.own_pose, correction.other_pose)
    apart = any(term.name == "azimuth_bias_rad" for term in correction.terms)
    t_ns, carrier = correction.valid_t_ns, correction.carrier
    true = true_frame(origin, truth, own, carrier, poses, t_ns, by_sensors=not apart)
    reported = np.array([axes.reported_east_m, axes.reported_north_m])
    after = np.array([axes.east_m, axes.north_m]) - true.place_m
    after_rad = float(wrap_pi(axes.rotation_rad - true.rotation_rad))
    covariance = symmetric(axes.covariance)
    error = np.append(after, after_rad)
    fixed = correction.fixed_axes
    shift = np.array([fixed.offset_east_m, fixed.offset_north_m]) if fixed else np.zeros(2)
    return FrameError(
        step=correction.step,
        t_ns=correction.valid_t_ns,
        state=correction.state,
        pairs=correction.pairs,
        before_m=_pair(reported - true.place_m),
        after_m=_pair(after),
        before_rad=float(wrap_pi(-true.rotation_rad)),
        after_rad=after_rad,
        fixed_before_m=_pair(reported - true.fixed_place_m),
        fixed_after_m=_pair(reported + shift - true.fixed_place_m),
        sigma_m=float(np.sqrt(covariance[0, 0] + covariance[1, 1])),
        sigma_rad=float(np.sqrt(covariance[2, 2])),
        nees=float(error @ np.linalg.solve(covariance, error)),
    )


def place_at(truth: TruthCarriers, index: int, t_ns: int) -> np.ndarray:
    """Where (3,) a carrier is when its own clock shows an instant: so its messages are stamped."""
    clock_s = truth.clock_offset_s[index] if truth.clock_offset_s else 0.0
    passed_s = (t_ns - truth.t_ns) * 1e-9 - clock_s
    way = np.array(truth.velocity_mps[index]) * passed_s
    return np.array(
        np.array(truth.position_m[index])
        + way
        + np.array(truth.acceleration_mps2[index]) * passed_s**2 / 2
    )


def reported_at(navigation: Sequence[Navigation], t_ns: int) -> Pose | None:
    """Where a carrier believes it is at an instant of its clock; None before its first message.

    Args:
        navigation: of the carrier, in order of time.
    """
    after = bisect_right(navigation, t_ns, key=_time)
    last = navigation[max(0, after - 2) : after]
    if not last:
        return None
    return pose_at(last if last[0].boot == last[-1].boot else last[-1:], t_ns)


def _time(message: TruthCarriers | Navigation) -> int:
    return message.t_ns


def _pair(vector: np.ndarray) -> tuple[float, float]:
    return float(vector[0]), float(vector[1])


def _rms(vectors: Sequence[Sequence[float]]) -> float:
    if not vectors:
        return float("nan")
    return float(np.sqrt(np.mean(np.sum(np.square(vectors), axis=1))))


def _site(pose: Pose) -> Site:
    return Site(pose.latitude_rad, pose.longitude_rad, pose.altitude_m)
