"""What a carrier's frame gets wrong stays in the tracks it has fed, and is counted once."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.consistency import mean_interval, nees
from estimation.tracking import frame_errors, imm
from estimation.tracking.frame_errors import MOST, SIZE, kept, met
from estimation.tracking.imm import Motion
from estimation.tracking.innovations import Common, Together
from estimation.tracking.measurements import places
from estimation.tracking.scan import Scan, View
from estimation.tracking.tracker import Picture, Settings, nothing, shown, step
from estimation.tracking.undetected import Region
from tests.estimation.tracking.states import some_bank

STILL = Settings(
    motion=Motion((1e-9,), (), (), 5.0), region=Region(half_m=50e3), gate=40.0, lifetime_s=1e9
)
SIGMA_M = 25.0
TARGET = np.array([9_000.0, -4_000.0])
PIVOT = np.array([-3_000.0, 2_000.0])
FRAME = np.diag([12.0, 15.0, 2e-3]) ** 2


def displacement(place_m: Array, pivot_m: Array) -> Array:
    """(2, 3) by q and D clockwise about the pivot."""
    east, north = place_m - pivot_m
    return np.array([[1.0, 0.0, north], [0.0, 1.0, -east]])


def scan(k: int, place_m: Array, common: Common | None) -> Scan:
    plots = places(place_m[None], SIGMA_M**2 * np.eye(2))
    return Scan(k * 10**9, plots, View(np.zeros(2)), 0.9, 1e-12, common)


def fed(
    commons: list[Common | None], rng: np.random.Generator, errors: list[Array] | None = None
) -> Picture:
    """The picture of one target at rest from a scan each."""
    picture = nothing(STILL, 0)
    for k, common in enumerate(commons):
        seen = TARGET + rng.normal(0, SIGMA_M, 2)
        if common is not None and errors is not None:
            seen = seen + displacement(TARGET, common.pivot_m) @ errors[k]
        picture, _ = step(picture, scan(k, seen, common), STILL)
    return picture


def place_covariance(picture: Picture) -> Array:
    covariance: Array = shown(picture, STILL).covariance[0, :2, :2]
    return covariance


def test_many_plots_of_one_carrier_know_a_place_no_better_than_its_frame() -> None:
    """At rest, n plots: the frame's covariance there, and that of the plots by n."""
    picture = fed([Common(FRAME, PIVOT, "b")] * 200, np.random.default_rng(1))
    by_frame = displacement(TARGET, PIVOT)
    want = by_frame @ FRAME @ by_frame.T
    spare = place_covariance(picture) - want
    assert np.linalg.eigvalsh(spare).min() > 0
    assert np.trace(spare) < 12 * SIGMA_M**2 / 200  # the speed is found along with the place


def test_many_plots_know_a_place_no_better_than_their_ranges() -> None:
    """Bias and scale hang together with the frame; across the line of sight they do no harm."""
    root = np.random.default_rng(8).normal(size=(5, 5)) / 4 + np.eye(5)
    sigma = np.array([12.0, 15.0, 2e-3, 40.0, 3e-3])
    errors = root @ root.T * np.outer(sigma, sigma)
    away = TARGET - PIVOT
    along = np.column_stack([away / np.hypot(*away), away])
    for frame in (errors, np.diag([0.0, 0.0, 0.0, 40.0, 3e-3]) ** 2):
        common = Common(frame, PIVOT, "b", ranges=SIZE)
        picture = fed([common] * 100, np.random.default_rng(1))
        by = np.hstack([displacement(TARGET, PIVOT), along])
        spare = place_covariance(picture) - by @ frame @ by.T
        assert np.linalg.eigvalsh(spare).min() > 0
        assert np.trace(spare) < 12 * SIGMA_M**2 / 100


def test_two_sources_of_a_carrier_share_its_frame_and_not_their_ranges() -> None:
    """At rest: half of what the ranges of each leave open, and all of what the frame does."""
    errors = np.diag([12.0, 15.0, 2e-3, 40.0, 1e-6, 40.0, 1e-6]) ** 2
    each = [Common(errors, PIVOT, "b", ranges=first) for first in (3, 5)]
    one, both = (
        fed([each[0]] * 150, np.random.default_rng(1)),
        fed(each * 75, np.random.default_rng(1)),
    )
    away = (TARGET - PIVOT) / np.hypot(*(TARGET - PIVOT))
    by_frame = displacement(TARGET, PIVOT) @ FRAME @ displacement(TARGET, PIVOT).T
    alone, together = (away @ (place_covariance(p) - by_frame) @ away for p in (one, both))
    assert alone == pytest.approx(40.0**2, rel=0.1)
    assert together == pytest.approx(40.0**2 / 2, rel=0.1)


def test_a_frame_without_a_name_is_forgotten_with_its_scan() -> None:
    rng = np.random.default_rng(1)
    named, nameless = (fed([Common(FRAME, PIVOT, name)] * 200, rng) for name in ("b", ""))
    assert np.trace(place_covariance(nameless)) < 0.1 * np.trace(place_covariance(named))


def test_the_point_a_frame_turns_about_is_of_no_matter() -> None:
    """The same error told of another point, as the carrier moves on, is the same error."""
    moved = PIVOT + np.array([4_000.0, 7_000.0])
    carry = np.eye(SIZE)
    carry[:, 2] = [moved[1] - PIVOT[1], PIVOT[0] - moved[0], 1.0]
    told = [Common(FRAME, PIVOT, "b"), Common(carry @ FRAME @ carry.T, moved, "b")]
    one = fed([told[0]] * 20, np.random.default_rng(2))
    other = fed([told[k % 2] for k in range(20)], np.random.default_rng(2))
    np.testing.assert_allclose(place_covariance(one), place_covariance(other), rtol=1e-6)


@pytest.mark.parametrize("alike", [0.0, 0.9], ids=["independent", "alike"])
def test_own_and_two_other_carriers_are_the_textbooks_consider_filter(alike: float) -> None:
    """State and both frames in one Kalman filter whose gain for the frames is nought.

    Frames that are followed together hang together: what one leaves open is in the other too.
    """
    frames = np.kron([[1.0, alike / 2], [alike / 2, 0.25]], FRAME)
    together = Together(("b", "c"), (3, 3), np.array([PIVOT, -PIVOT]), frames)
    own = None
    b, c = Common(FRAME, PIVOT, "b"), Common(FRAME / 4, -PIVOT, "c")
    if alike:
        b, c = b._replace(together=together), c._replace(together=together)
    commons: list[Common | None] = [b, own, c, b, b, c, own, b]
    picture = fed(commons, np.random.default_rng(3))
    joint = np.zeros((10, 10))
    joint[4:, 4:] = frames
    by_state, noise = np.eye(2, 10), SIGMA_M**2 * np.eye(2)
    forward = np.eye(10) + np.eye(10, k=2) * (np.arange(10) < 2)[:, None]
    for k, common in enumerate(commons):
        seen = by_state.copy()
        if common is not None:
            first = 4 if common is b else 7
            seen[:, first : first + 3] = displacement(TARGET, common.pivot_m)
        if k == 0:
            first_plot = seen[:, 4:] @ joint[4:, 4:]
            joint[:2, :2] = noise + first_plot @ seen[:, 4:].T
            joint[2:4, 2:4] = STILL.motion.sigma_speed_mps**2 * np.eye(2)
            joint[:2, 4:], joint[4:, :2] = -first_plot, -first_plot.T
            continue
        joint = forward @ joint @ forward.T
        gain = joint @ seen.T @ np.linalg.inv(seen @ joint @ seen.T + noise)
        gain[4:] = 0.0
        rest = np.eye(10) - gain @ seen
        joint = rest @ joint @ rest.T + gain @ noise @ gain.T
    found, sigma = place_covariance(picture), np.sqrt(np.diag(joint)[:2])
    scale = np.outer(sigma, sigma)
    np.testing.assert_allclose(found / scale, joint[:2, :2] / scale, atol=0.002)


@pytest.mark.parametrize("factor", [0.25, 1.0, 4.0])
def test_what_is_learnt_of_a_frame_is_no_longer_in_its_error(factor: float) -> None:
    """Known better: covariances shrink as the frame's; known worse, or as well: they stay."""
    root = np.random.default_rng(4).normal(size=(3, 3))
    before = root @ root.T + np.eye(3)
    want = min(factor, 1.0) * np.eye(3)
    np.testing.assert_allclose(kept(before, factor * before), want, atol=1e-9)


def test_only_so_many_frames_are_remembered() -> None:
    frames, bank = frame_errors.NONE, some_bank(np.random.default_rng(5), 3)
    for k in range(MOST + 3):
        frames, bank, common = met(frames, bank, Common(FRAME, PIVOT, f"c{k}"))
        assert common is not None
        assert common.slot == SIZE * (len(frames.names) - 1)
    assert frames.names == tuple(f"c{k}" for k in range(3, MOST + 3))
    assert bank.shared.shape[1] == MOST * SIZE


DRAWS = 60


class Course(NamedTuple):
    """How a frame is known from scan to scan, and what it gets wrong."""

    covariances: list[Array]
    errors: list[Array]


def same(rng: np.random.Generator, n: int) -> Course:
    error = rng.multivariate_normal(np.zeros(3), FRAME)
    return Course([FRAME] * n, [error] * n)


def learning(rng: np.random.Generator, n: int) -> Course:
    """Each scan tells as much of it as a third of what was known at first."""
    covariance, error = 9 * FRAME, rng.multivariate_normal(np.zeros(3), 9 * FRAME)
    told, course = np.linalg.inv(FRAME) / 3, Course([], [])
    for _ in range(n):
        course.covariances.append(covariance)
        course.errors.append(error)
        better = np.linalg.inv(np.linalg.inv(covariance) + told)
        news = rng.multivariate_normal(np.zeros(3), told)
        error = better @ (np.linalg.solve(covariance, error) + news)
        covariance = better
    return course


def drifting(rng: np.random.Generator, n: int) -> Course:
    covariances = [FRAME * (1 + k / 5) for k in range(n)]
    error, errors = rng.multivariate_normal(np.zeros(3), FRAME), []
    for _ in range(n):
        errors.append(error)
        error = error + rng.multivariate_normal(np.zeros(3), FRAME / 5)
    return Course(covariances, errors)


@pytest.mark.parametrize("way", [same, learning, drifting], ids=lambda way: way.__name__)
def test_tracks_of_another_carrier_alone_are_as_wrong_as_they_say(
    way: Callable[[np.random.Generator, int], Course],
) -> None:
    """Mean NEES of draws, of which each has a frame of its own, within its 99.9 % interval."""
    found = []
    for seed in range(DRAWS):
        rng = np.random.default_rng([7, seed])
        course = way(rng, 8)
        commons: list[Common | None] = [Common(c, PIVOT, "b") for c in course.covariances]
        picture = fed(commons, rng, course.errors)
        error = shown(picture, STILL).mean[0, :2] - TARGET
        found.append(float(nees(error, place_covariance(picture))))
    low, high = mean_interval(2, DRAWS, 0.999)
    assert low < np.mean(found) / 2 < high


def test_models_that_change_keep_what_they_share_with_frames() -> None:
    """Of equal models nothing changes hands; what a speed shares goes over to the place."""
    bank = some_bank(np.random.default_rng(6), 2)
    shared = np.random.default_rng(7).normal(size=(4, 3, 1, 2)) * np.ones((1, 1, 2, 1))
    after = imm.predicted(bank._replace(shared=shared), 2.0, Motion())
    np.testing.assert_allclose(after.shared[2:], shared[2:])
    np.testing.assert_allclose(after.shared[:2], shared[:2] + 2.0 * shared[2:])
