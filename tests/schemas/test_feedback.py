"""Messages in a corrected frame, and back: nothing else changes, and nothing is left of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import asdict, replace

from estimation.frames import rotation_clockwise
from schemas import codec
from schemas.feedback import (
    Corrected,
    corrected,
    correction_id,
    is_sent,
    own_navigation,
    own_report,
    renamed_id,
    uncorrected,
)
from schemas.messages import (
    Increment,
    Navigation,
    Pose,
    Ranging,
    Sector,
    SourceReport,
    TrackFilter,
)

ENVELOPE = {"carrier": "b", "boot": "x", "seq": 3, "t_ns": 17, "step": 9}
NAVIGATION = Navigation(
    **ENVELOPE,
    stream="navigation",
    pose=Pose(latitude_rad=0.7, longitude_rad=-0.1, heading_rad=1.0),
    reckoned_east_m=5.0,
)
PLOTS = SourceReport(
    **ENVELOPE,
    stream="radar",
    swept=Sector(start_rad=6.0, width_rad=1.0),
    bearing_rad=[0.1, None, 6.2],
    range_m=[1000.0, 2000.0, 3000.0],
    covariance_polar=[[1e-4, 0.0, 9.0], None, None],
    track_id=["1", "2", "3"],
)
TRACKS = SourceReport(
    **ENVELOPE,
    stream="arpa",
    kind=["track", "increment"],
    east_m=[300.0, -40.0],
    north_m=[100.0, 20.0],
    up_m=[1.0, None],
    covariance_position=[[4.0, 1.0, 0.1, 9.0, 0.2, 1.0], [4.0, 1.0, 9.0]],
    velocity_east_mps=[3.0, None],
    velocity_north_mps=[-2.0, 1.0],
    covariance_velocity=[[1.0, 0.2, 2.0], None],
    latitude_rad=[0.7, 0.7],
    longitude_rad=[0.1, 0.1],
    filter=[
        TrackFilter(
            model="constant_velocity",
            q=0.1,
            previous_t_ns=3,
            state=[300.0, 100.0, 3.0, -2.0],
            covariance=[4.0, 1.0, 0.3, 0.1, 9.0, 0.2, 0.5, 1.0, 0.1, 2.0],
        ),
        None,
    ],
    increment=[
        None,
        Increment(frame="carrier", y=[1.0, 2.0], information=[2.0, 0.3, 1.0]),
    ],
)
HELD = Corrected("fusion/b/4", Pose(latitude_rad=0.71, longitude_rad=-0.11, heading_rad=1.2), 0.2)
angles = st.floats(-math.pi, math.pi)


def test_a_navigation_says_both_poses_and_gives_its_own_back_to_the_bit() -> None:
    said = corrected(NAVIGATION, HELD)
    assert isinstance(said, Navigation)
    assert (said.pose, said.correction_id, said.uncorrected) == (
        HELD.pose,
        HELD.id,
        NAVIGATION.pose,
    )
    assert said.reckoned_east_m == NAVIGATION.reckoned_east_m
    assert uncorrected(codec.decode(Navigation, codec.encode(said))) == NAVIGATION


@settings(max_examples=50, deadline=None)
@given(angles)
def test_logs_come_back_but_for_rounding(angle: float) -> None:
    for report in (PLOTS, TRACKS):
        said = corrected(report, HELD._replace(turned_rad=angle))
        assert isinstance(said, SourceReport)
        assert (said.correction_id, said.turned_rad) == (HELD.id, angle)
        back = uncorrected(codec.decode(SourceReport, codec.encode(said)))
        assert _leaves(back) == pytest.approx(_leaves(report), rel=1e-12, abs=1e-12)


def test_every_direction_is_turned_clockwise_and_nothing_else() -> None:
    turn = rotation_clockwise(0.2)
    plots, tracks = corrected(PLOTS, HELD), corrected(TRACKS, HELD)
    assert isinstance(plots, SourceReport)
    assert isinstance(tracks, SourceReport)
    assert plots.bearing_rad == pytest.approx([0.3, None, 6.4 - 2 * math.pi])
    assert plots.swept == Sector(start_rad=6.2, width_rad=1.0)
    assert (plots.range_m, plots.covariance_polar) == (PLOTS.range_m, PLOTS.covariance_polar)
    assert [tracks.east_m[0], tracks.north_m[0]] == pytest.approx(turn @ [300.0, 100.0])
    velocity = [tracks.velocity_east_mps[0], tracks.velocity_north_mps[0]]
    assert velocity == pytest.approx(turn @ [3.0, -2.0])
    assert (tracks.velocity_east_mps[1], tracks.velocity_north_mps[1]) == (None, 1.0)
    assert tracks.latitude_rad == TRACKS.latitude_rad
    place = _matrix(tracks.covariance_position[0])
    whole = np.eye(3)
    whole[:2, :2] = turn
    assert place == pytest.approx(whole @ _matrix(TRACKS.covariance_position[0]) @ whole.T)
    four = np.kron(np.eye(2), turn)
    behind, before = tracks.filter[0], TRACKS.filter[0]
    assert behind.state == pytest.approx(four @ before.state)
    assert _matrix(behind.covariance) == pytest.approx(four @ _matrix(before.covariance) @ four.T)
    gained = tracks.increment[1]
    assert gained.y == pytest.approx(turn @ [1.0, 2.0])
    assert _matrix(gained.information) == pytest.approx(turn @ _matrix([2.0, 0.3, 1.0]) @ turn.T)


def test_increments_along_the_axes_of_the_earth_stay() -> None:
    gained = Increment(frame="ecef", y=[1.0, 2.0], information=[2.0, 0.3, 1.0])
    report = replace(TRACKS, increment=[gained, None])
    said = corrected(report, HELD)
    assert isinstance(said, SourceReport)
    assert said.increment == [gained, None]


def test_what_has_no_direction_holds_no_correction() -> None:
    ranging = Ranging(
        **ENVELOPE, stream="ranging", peer="c", kind="two_way", value_m=5.0, sigma_m=1.0
    )
    assert corrected(ranging, HELD) is ranging
    assert uncorrected(ranging) is ranging
    assert corrected(NAVIGATION, None) is NAVIGATION
    assert own_report(PLOTS) is PLOTS


def test_a_navigation_that_hides_its_own_pose_is_refused() -> None:
    with pytest.raises(ValueError, match="does not say its pose"):
        own_navigation(replace(NAVIGATION, correction_id="fusion/b/4"))


def test_only_what_can_have_been_sent_has_been() -> None:
    assert correction_id("fusion", "b", 4) == "fusion/b/4"
    assert is_sent("fusion/b/4", "fusion", "b", 5)
    assert not is_sent("fusion/b/5", "fusion", "b", 5)
    for wrong in ("fusion/c/4", "other/b/4", "fusion/b/04", "fusion/b/0", "fusion/b/-1", "b-4",
                  "fusion/b/٤", "fusion/b/" + "9" * 1000, "", "/", "fusion/b/"):  # fmt: skip
        assert not is_sent(wrong, "fusion", "b", 5), wrong


def test_a_carrier_that_is_called_otherwise_holds_its_own_corrections() -> None:
    assert renamed_id("fusion/b/4", "z") == "fusion/z/4"
    assert renamed_id("nonsense", "z") == "nonsense"


def _matrix(triangle: list[float]) -> np.ndarray:
    n = int((2 * len(triangle)) ** 0.5)
    full = np.zeros((n, n))
    full[np.triu_indices(n)] = triangle
    return full + np.triu(full, 1).T


def _leaves(message: object) -> list[object]:
    """Every number and text of a message; bearings as what they point to."""
    if isinstance(message, list | tuple):
        return [leaf for item in message for leaf in _leaves(item)]
    if hasattr(message, "__struct_fields__"):
        fields = asdict(message)  # type: ignore[arg-type]
        start, bearings = fields.pop("start_rad", None), fields.pop("bearing_rad", None)
        angles = [a for a in (start, *(bearings or ())) if a is not None]
        lines = [part for a in angles for part in (math.cos(a), math.sin(a))]
        return lines + [leaf for value in fields.values() for leaf in _leaves(value)]
    return [message] if isinstance(message, float) else []
