"""Which logs are taken for one target: the surest kind first, one-to-one, within the gate."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.frames import rotation_clockwise
from estimation.relative_frame import OwnAxesFrame
from fusion_center.relative_frames.association import associate, misclosures
from fusion_center.sources.sightings import Pair, Sightings
from fusion_center.state import Orders

GATE = 9.21
NO_ORDERS = Orders()
HERE = OwnAxesFrame(np.zeros(2), np.array(0.0), np.diag([1.0, 1.0, 1e-12]))


def seen(
    points: Array | Sequence[Sequence[float]],
    identity: Sequence[str] | None = None,
    *,
    carrier: str = "a",
    sigma_m: Sequence[float] | None = None,
) -> Sightings:
    places = np.array(points, dtype=float).reshape(-1, 2)
    n = len(places)
    sigmas = np.array(sigma_m or [10.0] * n)
    return Sightings(
        log=tuple(f"{carrier}/1/radar/1/{i}" for i in range(n)),
        source=("radar",) * n,
        fresh=(True,) * n,
        identity=tuple(identity or [""] * n),
        track=tuple(f"{carrier}/radar/t{i}" for i in range(n)),
        east_north_m=places,
        covariance=sigmas[:, None, None] ** 2 * np.eye(2),
        altitude_m=np.zeros(n),
        features=np.zeros((n, 0)),
    )


def found(
    own: Sightings, other: Sightings, frame: OwnAxesFrame | None = HERE, orders: Orders = NO_ORDERS
) -> set[tuple[int, int, str]]:
    pairs = associate(own, other, orders, frame, GATE)
    assert len({p.own for p in pairs}) == len({p.other for p in pairs}) == len(pairs)
    return {pair[:3] for pair in pairs}


FAR = [[0.0, 0.0], [9e5, 0.0], [0.0, 9e5]]


def test_an_identity_pairs_whatever_the_distance() -> None:
    own = seen(FAR, ["mmsi/1", "mmsi/2", ""])
    other = seen(FAR, ["mmsi/2", "", "mmsi/1"], carrier="b")
    assert found(own, other, None) == {(0, 2, "identity"), (1, 0, "identity")}


def test_identities_of_different_kinds_are_not_one() -> None:
    assert found(seen(FAR[:1], ["mmsi/1"]), seen(FAR[:1], ["icao/1"]), None) == set()


def test_of_several_sources_the_best_log_meets_the_best() -> None:
    own = seen([[0, 0], [0, 0]], ["n/p", "n/p"], sigma_m=[30.0, 10.0])
    other = seen([[0, 0], [0, 0], [0, 0]], ["n/p"] * 3, sigma_m=[9.0, 50.0, 5.0])
    assert found(own, other, None) == {(1, 2, "identity"), (0, 0, "identity")}


def test_coordinates_pair_only_in_a_known_frame() -> None:
    own, other = seen([[100.0, 0.0]]), seen([[105.0, 0.0]], carrier="b")
    assert found(own, other, None) == set()
    assert found(own, other, HERE) == {(0, 0, "coordinates")}


@pytest.mark.parametrize(("distance2", "pairs"), [(9.2, 1), (9.22, 0)])
def test_the_gate_is_the_whole_covariance(distance2: float, pairs: int) -> None:
    """S along east: 10^2 + 20^2 + 30^2 of the frame."""
    frame = OwnAxesFrame(np.zeros(2), np.array(0.0), np.diag([30.0**2, 1.0, 1e-12]))
    apart = np.sqrt(distance2 * (10**2 + 20**2 + 30**2))
    own, other = seen([[apart, 0.0]]), seen([[0.0, 0.0]], sigma_m=[20.0], carrier="b")
    assert len(found(own, other, frame)) == pairs


def test_misclosures_are_those_of_the_frame() -> None:
    """Against 20,000 drawn frames and logs: S within 4 * sqrt(2 / 20000), 4 %."""
    rng = np.random.default_rng(2)
    root = np.diag([50.0, 80.0, 0.01]) @ np.array([[1, 0, 0], [0.5, 1, 0], [0.3, -0.4, 1]])
    frame = OwnAxesFrame(np.array([5000.0, -3000.0]), np.array(0.3), root @ root.T)
    point = np.array([2000.0, 7000.0])
    own, other = seen([[0.0, 0.0]]), seen([point], sigma_m=[40.0], carrier="b")
    drawn = np.array([*frame.q_m, frame.D_rad]) + rng.normal(size=(20_000, 3)) @ root.T
    measured = point + rng.normal(0, 40.0, (20_000, 2))
    turned = (rotation_clockwise(drawn[:, 2]) @ measured[..., None])[..., 0]
    predicted = drawn[:, :2] + turned + rng.normal(0, 10.0, (20_000, 2))
    which = np.array([0])
    _, determinant = misclosures(own, other, frame, which, which)
    assert np.linalg.det(np.cov(predicted.T)) == pytest.approx(determinant[0, 0], rel=0.08)


def test_the_likeliest_of_all_assignments_is_taken() -> None:
    """Against every permutation of five close targets, all within the gate."""
    rng = np.random.default_rng(4)
    for _ in range(20):
        points = rng.normal(0, 8, (5, 2))
        own, other = seen(points), seen(points + rng.normal(0, 3, (5, 2)), carrier="b")
        which = np.arange(5)
        distance2, _ = misclosures(own, other, HERE, which, which)
        best = min(permutations(range(5)), key=lambda p: float(distance2[which, list(p)].sum()))
        assert found(own, other) == {(i, j, "coordinates") for i, j in enumerate(best)}


def test_a_log_is_left_alone_rather_than_paired_beyond_the_gate() -> None:
    own, other = seen([[0.0, 0.0], [60.0, 0.0]]), seen([[1.0, 0.0], [500.0, 0.0]], carrier="b")
    assert found(own, other) == {(0, 0, "coordinates")}


def test_paired_logs_take_no_part_in_a_later_kind() -> None:
    own = seen([[0.0, 0.0], [2.0, 0.0]], ["n/p", ""])
    other = seen([[2.0, 0.0], [0.0, 0.0]], ["n/p", ""], carrier="b")
    assert found(own, other) == {(0, 0, "identity"), (1, 1, "coordinates")}


def test_contradicting_identities_never_pair_by_coordinates() -> None:
    own, other = seen([[0.0, 0.0]], ["n/p"]), seen([[0.0, 0.0]], ["n/q"], carrier="b")
    assert found(own, other) == set()
    other_kind = seen([[0.0, 0.0]], ["icao/q"], carrier="b")
    assert found(own, other_kind) == {(0, 0, "coordinates")}


def test_an_operator_binds_and_forbids() -> None:
    own = seen([[0.0, 0.0], [50.0, 0.0]], ["n/p", ""])
    other = seen([[0.0, 0.0], [50.0, 0.0]], ["n/p", ""], carrier="b")
    bound = Orders(bound=(("a/radar/t0", "b/radar/t1"),))
    assert found(own, other, HERE, bound) == {(0, 1, "operator")}
    forbidden = Orders(forbidden=(("a/radar/t0", "b/radar/t0"), ("a/radar/t1", "b/radar/t1")))
    assert found(own, other, HERE, forbidden) == set()


def test_a_binding_of_an_absent_track_waits() -> None:
    own, other = seen([[0.0, 0.0]]), seen([[0.0, 0.0]], carrier="b")
    absent = Orders(bound=(("a/radar/t0", "b/radar/t9"),))
    assert found(own, other, HERE, absent) == {(0, 0, "coordinates")}


def test_nothing_pairs_with_nothing() -> None:
    assert found(seen([]), seen([[0.0, 0.0]])) == set()
    assert found(seen([]), seen([])) == set()
    assert Pair(0, 0, "identity").method == "identity"
