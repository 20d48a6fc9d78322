"""Points in boxes, against a look at every point for every box."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.tracking.strips import inside, unfolded


def looked_at(low: Array, high: Array, points: Array) -> set[tuple[int, int]]:
    every = (points[:, None] >= low[..., None]) & (points[:, None] <= high[..., None])
    return set(zip(*(ends.tolist() for ends in np.nonzero(every.all(axis=0))), strict=True))


@pytest.mark.parametrize("seed", range(20))
def test_all_points_in_boxes_are_found_and_no_others(seed: int) -> None:
    """Boxes of very different sizes, points on their edges, points in one place."""
    rng = np.random.default_rng(seed)
    points = np.round(rng.normal(0, [[300.0], [0.02]], (2, 200)), rng.integers(0, 6))
    centre = rng.normal(0, [[400.0], [0.03]], (2, 80))
    half = np.exp(rng.normal(0, 2, (2, 80))) * [[30.0], [0.003]]
    low, high = centre - half, centre + half
    low[:, :9], high[:, :9] = points[:, :9], points[:, :9]  # boxes of one point
    low[:, 9:12], high[:, 9:12] = -np.inf, np.inf
    box, point = inside(low, high, points)
    assert (np.diff(box) >= 0).all()
    assert len(set(zip(box.tolist(), point.tolist(), strict=True))) == len(box)
    assert set(zip(box.tolist(), point.tolist(), strict=True)) == looked_at(low, high, points)


@pytest.mark.parametrize("scale", [[[1.0], [0.0]], [[0.0], [1.0]], [[0.0], [0.0]]])
def test_points_on_a_line_or_all_in_one_place(scale: list[list[float]]) -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(0, 1, (2, 30)) * scale
    low = rng.normal(-0.5, 1, (2, 20))
    high = low + 1.0
    found = {(int(b), int(p)) for b, p in zip(*inside(low, high, points), strict=True)}
    assert found == looked_at(low, high, points)


def test_boxes_that_hold_nothing() -> None:
    points = np.array([[0.0, 1.0], [0.0, 1.0]])
    nothing = np.empty((2, 0))
    for low, high, given in (
        (points + 5, points + 6, points),  # beside all points
        (points + 1, points - 1, points),  # turned inside out
        (np.full((2, 1), np.nan), np.full((2, 1), np.nan), points),
        (nothing, nothing, points),
        (points, points, nothing),
    ):
        assert inside(low, high, given)[0].size == 0


def test_runs_are_unfolded_in_order() -> None:
    owner, number = unfolded(np.array([3, 7, 7]), np.array([5, 7, 8]))
    assert owner.tolist() == [0, 0, 2]
    assert number.tolist() == [3, 4, 7]
