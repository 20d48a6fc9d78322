"""Measures of a picture: against all assignments tried one by one, against their own laws."""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np
import pytest

from bench.figures import time_ratio
from estimation.consistency import mean_interval
from estimation.metrics import (
    Picture,
    gospa,
    gospa_over_time,
    identity_changes,
    matched,
    matched_nees,
    ospa,
    siap,
)


def pictures(rng, most: int = 5, d: int = 2):
    return (rng.uniform(0, 4, (rng.integers(0, most + 1), d)) for _ in range(2))


def every_assignment(n: int, m: int):
    """Every partial one-to-one assignment of n objects and m estimates."""
    for k in range(min(n, m) + 1):
        for objects in combinations(range(n), k):
            for estimates in permutations(range(m), k):
                yield objects, estimates


def gospa_by_trial(truth, estimate, c, p):
    n, m = len(truth), len(estimate)
    costs = []
    for i, j in every_assignment(n, m):
        d = np.linalg.norm(truth[list(i)] - estimate[list(j)], axis=-1)
        costs.append(np.sum(np.minimum(d, c) ** p) + c**p / 2 * (n + m - 2 * len(i)))
    return min(costs) ** (1 / p)


def ospa_by_trial(truth, estimate, c, p):
    n, m = len(truth), len(estimate)
    if max(n, m) == 0:
        return 0.0
    costs = []
    for i, j in every_assignment(n, m):
        if len(i) == min(n, m):
            d = np.linalg.norm(truth[list(i)] - estimate[list(j)], axis=-1)
            costs.append(np.sum(np.minimum(d, c) ** p) + c**p * abs(n - m))
    return (min(costs) / max(n, m)) ** (1 / p)


@pytest.mark.parametrize("p", [1.0, 2.0, 3.5])
@pytest.mark.parametrize("c", [0.5, 1.5, 10.0])
def test_both_metrics_are_the_least_over_all_assignments(c: float, p: float) -> None:
    rng = np.random.default_rng([int(10 * c), int(10 * p)])
    for _ in range(12):
        truth, estimate = pictures(rng, 4)
        assert gospa(truth, estimate, c, p).distance == pytest.approx(
            gospa_by_trial(truth, estimate, c, p)
        )
        assert ospa(truth, estimate, c, p).distance == pytest.approx(
            ospa_by_trial(truth, estimate, c, p)
        )


def test_metric_axioms() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        x, y = pictures(rng)
        z, _ = pictures(rng)
        for metric in (gospa, ospa):
            xy, yz, xz = (float(metric(a, b, c=1.3).distance) for a, b in ((x, y), (y, z), (x, z)))
            assert metric(x, x, c=1.3).distance == 0
            assert xy == pytest.approx(metric(y, x, c=1.3).distance)
            assert xz <= xy + yz + 1e-12
            assert metric(x + 7.0, y + 7.0, c=1.3).distance == pytest.approx(xy)


def test_parts_add_up_and_count_what_is_wrong() -> None:
    truth = np.array([[0.0, 0.0], [100.0, 0.0], [200.0, 0.0]])
    estimate = np.array([[3.0, 4.0], [100.0, 12.0], [900.0, 0.0], [950.0, 0.0]])
    found = gospa(truth, estimate, c=20.0)
    assert (found.missed_count, found.false_count) == (1, 2)
    assert found.localisation == pytest.approx(13.0)
    assert found.missed == pytest.approx(np.sqrt(200.0))
    assert found.false == pytest.approx(20.0)
    assert found.distance**2 == pytest.approx(13.0**2 + 200.0 + 400.0)
    apart = ospa(truth, estimate, c=20.0)
    assert apart.localisation**2 == pytest.approx((13.0**2 + 400.0) / 4)
    assert apart.cardinality**2 == pytest.approx(100.0)


@pytest.mark.parametrize("shape", [(0, 2), (0,)])
def test_nobody_is_there_or_nobody_is_seen(shape) -> None:
    nobody = np.empty(shape)
    four = np.zeros((4, 2))
    assert gospa(nobody, nobody, c=2.0).distance == 0
    assert gospa(four, nobody, c=2.0).missed == pytest.approx(np.sqrt(8.0))
    assert gospa(nobody, four, c=2.0).false_count == 4
    assert ospa(nobody, nobody, c=2.0).distance == 0
    assert ospa(four, nobody, c=2.0).distance == pytest.approx(2.0)


@pytest.mark.parametrize(("c", "p"), [(0.0, 2.0), (-1.0, 2.0), (1.0, 0.5), (float("nan"), 2.0)])
def test_a_cut_off_without_sense_is_refused(c: float, p: float) -> None:
    with pytest.raises(ValueError, match="cut-off"):
        gospa(np.zeros((1, 2)), np.zeros((1, 2)), c, p)


def test_places_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match="finite places"):
        gospa(np.array([[np.nan, 0.0]]), np.zeros((1, 2)), 1.0)
    with pytest.raises(ValueError, match=r"shape \(2,\)"):
        gospa(np.zeros(2), np.zeros((1, 2)), 1.0)


def test_ten_thousand_objects_are_no_cube() -> None:
    """Ten times the objects at the same density take nowhere near 1000 times as long."""
    rng = np.random.default_rng(4)

    def scene(n: int):
        truth = rng.uniform(0, 1000 * np.sqrt(n), (n, 2))
        return truth, truth + rng.normal(0, 200, (n, 2))

    small, large = scene(1000), scene(10_000)
    ratio = time_ratio(lambda: gospa(*large, c=1000.0), lambda: gospa(*small, c=1000.0), repeats=3)
    assert ratio < 200  # measured 10 to 21, on a busy machine; a cube would be 1000


def run(rng, steps: int = 12, objects: int = 6):
    """A truth, and tracks of it with gaps, redundant ones and false ones."""
    step = np.repeat(np.arange(steps) * 5, objects)
    who = np.tile(np.arange(objects), steps)
    place = np.column_stack([who * 50.0 + step, rng.uniform(0, 10, len(who))])
    seen = rng.random(len(who)) < 0.8
    false = rng.uniform(0, 400, (2 * steps, 2))
    tracks = Picture(
        np.concatenate([step[seen], np.repeat(np.arange(steps) * 5, 2)]),
        np.concatenate([100 + who[seen], 500 + np.arange(2 * steps)]),
        np.concatenate([place[seen] + rng.normal(0, 3, (seen.sum(), 2)), false]),
    )
    return Picture(step, who, place), tracks


def test_all_instants_at_once_are_each_by_itself() -> None:
    truth, tracks = run(np.random.default_rng(5))
    together = gospa_over_time(truth, tracks, c=30.0)
    for t, step in enumerate(np.unique(truth.step)):
        once = gospa(truth.place[truth.step == step], tracks.place[tracks.step == step], c=30.0)
        np.testing.assert_allclose([part[t] for part in together], once, rtol=1e-12)


def test_an_instant_without_objects_has_false_tracks_only() -> None:
    nobody = Picture(np.empty(0, int), np.empty(0, int), np.empty((0, 2)))
    tracks = Picture(np.array([1, 2, 2]), np.array([1, 1, 2]), np.zeros((3, 2)))
    assert gospa_over_time(nobody, tracks, c=1.0).false_count.tolist() == [1, 2]
    assert np.isnan(siap(nobody, tracks, c=1.0).completeness)
    assert siap(nobody, tracks, c=1.0).spuriousness == 1.0
    assert siap(tracks, nobody, c=1.0).completeness == 0.0


def test_siap_of_a_run_that_can_be_counted_by_hand() -> None:
    """Object 1 is held by a, a, b, a; object 2 by c at two instants, twice at one of them."""
    truth = Picture(
        np.array([1, 2, 3, 4, 1, 2, 3, 4]),
        np.array([1, 1, 1, 1, 2, 2, 2, 2]),
        np.array([[0.0]] * 4 + [[1000.0]] * 4),
    )
    tracks = Picture(
        np.array([1, 2, 3, 4, 2, 3, 3, 4]),
        np.array(["a", "a", "b", "a", "c", "c", "d", "e"]),
        np.array([[1.0], [2.0], [3.0], [4.0], [1002.0], [1002.0], [1006.0], [5000.0]]),
    )
    found = siap(truth, tracks, c=10.0)
    assert found.completeness == pytest.approx(6 / 8)
    assert found.ambiguity == pytest.approx(7 / 6)
    assert found.spuriousness == pytest.approx(1 / 8)
    assert found.accuracy == pytest.approx((1 + 2 + 3 + 4 + 2 + 2) / 6)
    assert found.identity_changes == 2
    assert found.longest == pytest.approx((3 + 2) / 8)


def test_a_perfect_picture() -> None:
    truth, _ = run(np.random.default_rng(6))
    renamed = truth._replace(identity=900 - truth.identity)
    assert siap(truth, renamed, c=20.0) == (1.0, 1.0, 0.0, 0.0, 0, 1.0)


def test_identity_changes_survive_gaps_order_and_names() -> None:
    step = np.array([1, 2, 5, 6, 1, 3])
    who = np.array([1, 1, 1, 1, 2, 2])
    track = np.array([7, 7, 8, 7, 8, 8])
    assert identity_changes(step, who, track) == 2  # the gap from 2 to 5 hides no change
    order = np.random.default_rng(7).permutation(6)
    assert identity_changes(step[order], who[order], track[order]) == 2
    assert identity_changes(step, who.astype(str), -track) == 2
    none = np.empty(0, dtype=int)
    assert identity_changes(none, none, none) == 0


def test_two_tracks_that_swap_count_once_for_each_object() -> None:
    step = np.repeat([1, 2], 2)
    place = np.array([[0.0], [100.0], [0.0], [100.0]])
    truth = Picture(step, np.array([1, 2, 1, 2]), place)
    tracks = Picture(step, np.array([1, 2, 2, 1]), place)
    assert siap(truth, tracks, c=10.0).identity_changes == 2


def test_nees_of_the_matched() -> None:
    rng = np.random.default_rng(8)
    covariance = np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 9.0]])
    truth = np.column_stack([1000.0 * np.arange(3000.0), np.zeros(3000), np.zeros(3000)])
    order = rng.permutation(3000)
    estimate = (truth + rng.multivariate_normal(np.zeros(3), covariance, 3000))[order]
    pairs = matched(truth[:, :2], estimate[:, :2], c=30.0)
    np.testing.assert_array_equal(order[pairs.estimate], pairs.truth)
    errors = matched_nees(truth, estimate, np.broadcast_to(covariance, (3000, 3, 3)), pairs)
    low, high = mean_interval(3, 3000, confidence=0.999)
    assert low < errors.mean() / 3 < high
