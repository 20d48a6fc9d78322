"""The last two logs of a target and the straight line through them, covariance included."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from estimation.arrays import Array
from fusion_center.settings import LogSettings
from fusion_center.sources.coordinates import Places
from fusion_center.sources.logs import NO_LOGS, Absorbed, Rules, with_report
from fusion_center.sources.sightings import at_instant, sightings
from fusion_center.state import SourceLogs
from schemas.messages import Sector, SourceReport

SECOND = 1_000_000_000
SETTINGS = LogSettings(
    max_age_s=10.0, single_max_age_s=1.0, sigma_velocity_mps=20.0, sigma_acceleration_mps2=0.0
)
STILL = np.zeros(2)


def report(t_s: float, seq: int = 1, **columns: Any) -> SourceReport:
    t_ns = round((100 + t_s) * SECOND)
    return SourceReport(carrier="a", boot="x", stream="radar", seq=seq, t_ns=t_ns, **columns)


def at(points: Sequence[Sequence[float]], sigma_m: float = 10.0) -> Places:
    n = len(points)
    return Places(
        np.array(points, dtype=float).reshape(n, 2),
        np.tile(sigma_m**2 * np.eye(2), (n, 1, 1)),
        np.zeros(n),
        np.zeros(n, dtype=bool),
    )


def take(
    logs: SourceLogs,
    t_s: float,
    points: Sequence[Sequence[float]],
    settings: LogSettings = SETTINGS,
    way_m: Array = STILL,
    sigma_m: float = 10.0,
    **columns: Any,
) -> tuple[SourceLogs, Absorbed]:
    columns = columns or {"track_id": [f"t{i}" for i in range(len(points))]}
    said = report(t_s, seq=round(t_s) + 1, **columns)
    return with_report(
        logs, said, at(points, sigma_m), np.tile(way_m, (len(points), 1)), Rules(settings)
    )


def predict(
    logs: SourceLogs, t_s: float, settings: LogSettings = SETTINGS
) -> tuple[list[str], Array, Array]:
    which, place, covariance = at_instant(logs, round((100 + t_s) * SECOND), settings)
    return [logs.key[i] for i in which], place, covariance


@pytest.mark.parametrize(("t_s", "a"), [(2.0, 1.0), (3.0, 1.5), (6.0, 3.0), (1.0, 0.5)])
def test_two_logs_are_carried_on_in_a_straight_line(t_s: float, a: float) -> None:
    logs, _ = take(NO_LOGS, 0.0, [[0.0, 100.0]], sigma_m=10.0)
    logs, _ = take(logs, 2.0, [[20.0, 60.0]], sigma_m=5.0)
    _, place, covariance = predict(logs, t_s)
    np.testing.assert_allclose(place, [[10 * t_s, 100 - 20 * t_s]], atol=1e-6)
    np.testing.assert_allclose(covariance[0], (a**2 * 25 + (1 - a) ** 2 * 100) * np.eye(2))


def test_the_covariance_of_the_line_is_the_scatter_of_its_end() -> None:
    """4000 targets of known velocity: variances come out within 4 * sqrt(2 / 8000), 6 %."""
    rng = np.random.default_rng(3)
    n, velocity = 4000, np.array([7.0, -4.0])
    first = rng.normal(0, 10, (n, 2))
    second = 1.5 * velocity + rng.normal(0, 10, (n, 2))
    logs, _ = take(NO_LOGS, 0.0, first.tolist())
    logs, _ = take(logs, 1.5, second.tolist())
    _, place, covariance = predict(logs, 2.4)
    error = place - 2.4 * velocity
    assert np.mean(error**2) == pytest.approx(covariance[0, 0, 0], rel=0.06)


def test_an_acceleration_is_covered() -> None:
    settings = LogSettings(sigma_acceleration_mps2=2.0)
    logs, _ = take(NO_LOGS, 0.0, [[0.0, 0.0]], settings)
    logs, _ = take(logs, 2.0, [[0.0, 0.0]], settings)
    _, place, covariance = predict(logs, 5.0, settings)
    curved_m = 0.5 * 2.0 * 5.0 * 3.0  # what 2 m/s^2 puts between the line and the target
    plain = 100 * (2.5**2 + 1.5**2)
    np.testing.assert_allclose(covariance[0], (plain + curved_m**2) * np.eye(2))
    np.testing.assert_array_equal(place, 0.0)


def test_a_single_log_stands_with_unknown_velocity_and_only_while_young() -> None:
    logs, _ = take(NO_LOGS, 0.0, [[5.0, 6.0]])
    _, place, covariance = predict(logs, 0.5)
    np.testing.assert_array_equal(place, [[5.0, 6.0]])
    np.testing.assert_allclose(covariance[0], (100 + (20 * 0.5) ** 2) * np.eye(2))
    assert predict(logs, 0.0)[2][0, 0, 0] == 100.0
    assert predict(logs, 1.01)[0] == []


def test_nothing_is_carried_on_beyond_its_age_nor_over_a_longer_gap() -> None:
    logs, _ = take(NO_LOGS, 0.0, [[0.0, 0.0]])
    near, _ = take(logs, 9.0, [[9.0, 0.0]])
    assert predict(near, 19.0)[0] == ["t/t0"]
    assert predict(near, 19.1)[0] == []
    far, _ = take(logs, 10.5, [[9.0, 0.0]])
    assert far.t_ns[1, 0] == -1


def test_a_moving_carrier_sees_its_targets_move_the_other_way() -> None:
    """The target moves (5, 0) m/s, the carrier (2, 8) m/s: places are relative to the carrier."""
    logs = NO_LOGS
    for t in (0.0, 1.0):
        way = t * np.array([2.0, 8.0])
        logs, _ = take(logs, t, [np.array([1000.0 + 5 * t, 0.0]) - way], way_m=way)
    seen = sightings("a", 1, {"radar": logs}, 103 * SECOND, 3 * np.array([2.0, 8.0]), SETTINGS)
    np.testing.assert_allclose(seen.east_north_m, [[1000 + 5 * 3 - 2 * 3, -8 * 3]])


def test_targets_of_earlier_reports_are_kept_while_young() -> None:
    logs, _ = take(NO_LOGS, 0.0, [[0.0, 0.0], [1.0, 1.0]], track_id=["p", "q"])
    logs, _ = take(logs, 4.0, [[2.0, 2.0]], track_id=["q"])
    assert logs.key == ("t/q", "t/p")
    logs, _ = take(logs, 11.0, [[3.0, 3.0]], track_id=["q"])
    assert logs.key == ("t/q",)


def test_plots_without_a_name_are_followed_as_tracks_of_the_source() -> None:
    """Two targets, one of them missed once and one false plot: three tracks, one of them gone."""
    logs = NO_LOGS
    for t in range(6):
        points = [[0.0 + 5 * t, 0.0], [900.0, 7.0 * t]]
        points = points[:1] if t == 3 else points
        points = [*points, [-3000.0, 50.0]] if t == 2 else points
        logs, _ = take(logs, float(t), points, track_id=[None] * len(points))
    assert sorted(zip(logs.key, logs.hits.tolist(), strict=True)) == [("#0", 6), ("#1", 5)]
    assert logs.born == 3
    assert logs.existence.min() > 0.99
    first = logs.key.index("#0")
    np.testing.assert_allclose(logs.state[first, 2:], [5.0, 0.0], atol=1.0)


def test_a_gross_error_under_a_name_does_not_bend_its_track_but_two_begin_it_anew() -> None:
    logs = NO_LOGS
    for t in range(5):
        logs, _ = take(logs, float(t), [[5.0 * t, 0.0]])
    wild, _ = take(logs, 5.0, [[25.0, 700.0]])
    np.testing.assert_allclose(wild.state[0, :2], [25.0, 0.0], atol=10.0)
    back, _ = take(wild, 6.0, [[30.0, 0.0]])
    np.testing.assert_allclose(back.state[0], [30.0, 0.0, 5.0, 0.0], atol=6.0)
    moved, _ = take(wild, 6.0, [[30.0, 700.0]])
    np.testing.assert_allclose(moved.state[0, :2], [30.0, 700.0])


def test_a_look_elsewhere_says_nothing_of_a_nameless_target() -> None:
    logs, _ = take(NO_LOGS, 0.0, [[0.0, 1000.0], [1000.0, 0.0]], track_id=[None, None])
    east = Sector(start_rad=1.0, width_rad=1.0)
    part, _ = take(logs, 0.5, [[5000.0, 0.0]], track_id=[None], swept=east)
    assert set(part.key) == {"#0", "#2"}  # the one in the east has been missed


@pytest.mark.parametrize("name", ["identity", "track_id"])
def test_a_name_claimed_twice_is_used_for_none(name: str) -> None:
    logs, _ = take(NO_LOGS, 0.0, [[0.0, 0.0]], **{name: ["p"]})
    logs, absorbed = take(
        logs, 1.0, [[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]], **{name: ["p", "q", "p"]}
    )
    assert [key.rpartition("/")[2] for key in logs.key] == ["q"]
    assert len(absorbed.claimed_twice) == 1
    assert "p" in absorbed.claimed_twice[0]


def test_what_cannot_be_used_is_counted() -> None:
    places = at([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [np.nan, np.nan]])
    places.covariance[1:3] = places.east_north_m[2] = np.nan
    places.defaulted[:2] = True
    said = report(1.0, track_id=list("pqrs"), kind=["plot", "plot", "increment", "plot"])
    logs, absorbed = with_report(NO_LOGS, said, places, np.zeros((4, 2)), Rules(SETTINGS))
    assert logs.key == ("t/p",)
    assert absorbed == Absorbed(logs=4, sigma_defaults=2, without_sigma=1, increments=1)


def test_a_log_older_than_what_is_known_changes_nothing() -> None:
    logs, _ = take(NO_LOGS, 1.0, [[1.0, 0.0]])
    after, absorbed = take(logs, 0.0, [[0.0, 0.0]])
    assert absorbed.superseded == 1
    np.testing.assert_array_equal(after.t_ns, logs.t_ns)
    np.testing.assert_array_equal(after.place_m, logs.place_m)


def test_offsets_and_their_sigmas_belong_to_the_log() -> None:
    logs, _ = take(
        NO_LOGS, 1.0, [[0.0, 0.0]], track_id=["p"], time_offset_s=[-0.25], sigma_time_offset_s=[0.5]
    )
    assert logs.t_ns[0, 0] == round(100.75 * SECOND)
    np.testing.assert_allclose(logs.covariance[0, 0], (100 + (20 * 0.5) ** 2) * np.eye(2))


def test_a_flood_of_names_is_bounded() -> None:
    settings = LogSettings(max_per_source=5)
    logs = NO_LOGS
    for t in range(4):
        names = [f"{t}-{i}" for i in range(4)]
        logs, _ = take(
            logs, float(t), [[float(i), 0.0] for i in range(4)], settings, track_id=names
        )
    assert logs.key == ("t/3-0", "t/3-1", "t/3-2", "t/3-3", "t/2-0")


def test_sightings_name_the_newest_log_and_the_track() -> None:
    logs, _ = take(NO_LOGS, 0.0, [[0.0, 0.0], [1.0, 1.0]], track_id=["p", None])
    logs, _ = take(logs, 1.0, [[4.0, 4.0], [0.0, 0.0]], track_id=[None, "p"],
                   identity=["239", None], identity_kind=["mmsi", None])  # fmt: skip
    seen = sightings("a", 3, {"radar": logs}, 101 * SECOND, STILL, SETTINGS)
    assert seen.log == ("a/3/radar/2/0", "a/3/radar/2/1")
    assert seen.identity == ("mmsi/239", "")
    assert seen.track == ("", "a/radar/p")
    assert seen.source == ("radar", "radar")


def test_a_recycled_track_number_brings_no_past_with_it() -> None:
    logs, _ = take(NO_LOGS, 0.0, [(0.0, 0.0), (5.0, 5.0)])
    logs, absorbed = take(logs, 1.0, [(20_000.0, 0.0), (35.0, 5.0)])
    assert absorbed.recycled == ("t0",)
    two = {name: bool(before >= 0) for name, before in zip(logs.key, logs.t_ns[1], strict=True)}
    assert two == {"t/t0": False, "t/t1": True}


def test_a_large_sigma_explains_a_leap() -> None:
    logs, _ = take(NO_LOGS, 0.0, [(0.0, 0.0)], sigma_m=3000.0)
    _, absorbed = take(logs, 1.0, [(20_000.0, 0.0)], sigma_m=3000.0)
    assert absorbed.recycled == ()


def test_a_log_measured_long_after_its_report_is_left_out_and_blocks_nothing() -> None:
    logs, absorbed = take(NO_LOGS, 0.0, [(0.0, 0.0)], track_id=["a"], time_offset_s=[1e6])
    assert (absorbed.astray, logs.key) == (1, ())
    logs, absorbed = take(logs, 1.0, [(1.0, 0.0)], track_id=["a"])
    assert (absorbed.superseded, logs.key) == (0, ("t/a",))
