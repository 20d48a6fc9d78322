"""Laws of the picture's axes: places, bearings and covariances of a carrier turn together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimation.frames import Site, east_north_from_polar, target_from_source, wrap_pi
from estimation.relative_frame import OwnAxesFrame
from estimation.relative_frame.range_errors import declared
from fusion_center.picture.axes import Placed, Unsure

ORIGIN = Site(0.62, -0.1, 0.0)
OWN, OTHER = Site(0.6215, -0.098, 20.0), Site(0.6195, -0.103, 15.0)
CORRECTION = OwnAxesFrame(np.array([-9_000.0, 4_000.0]), np.array(0.3), np.diag([9.0, 4.0, 1e-6]))


def axes(*, corrected: bool) -> Placed:
    picture = target_from_source(ORIGIN, OWN)
    if not corrected:
        return Placed(OWN, OWN, None, None, picture)
    unsure = Unsure(CORRECTION.covariance, {})
    return Placed(OTHER, OWN, target_from_source(OWN, OTHER), CORRECTION, picture, unsure)


@pytest.mark.parametrize("corrected", [False, True], ids=["own", "other"])
def test_what_is_seen_at_a_bearing_lies_at_the_turned_bearing(corrected: bool) -> None:
    seen = axes(corrected=corrected)
    bearing = np.linspace(0.0, 6.0, 7)
    place = seen.places_m(east_north_from_polar(bearing, 2_000.0), np.full(7, 15.0))
    east, north = (place - seen.place_m()).T
    apart = wrap_pi(np.arctan2(east, north) - bearing - seen.turn_rad)
    assert np.abs(apart).max() < 1e-4  # level planes a few kilometres apart
    assert np.hypot(east, north) == pytest.approx(2_000.0, rel=1e-4)


@pytest.mark.parametrize("corrected", [False, True], ids=["own", "other"])
def test_covariances_turn_as_places_do(corrected: bool) -> None:
    seen = axes(corrected=corrected)
    ends = seen.places_m(np.array([[300.0, 0.0], [-300.0, 0.0]]), np.full(2, 15.0))
    along = (ends[0] - ends[1]) / 600.0
    turned = seen.turned(np.diag([900.0, 1.0])[None])[0]
    assert along @ turned @ along == pytest.approx(900.0, rel=1e-3)


def test_a_corrected_carrier_is_where_its_correction_says() -> None:
    own, other = axes(corrected=False), axes(corrected=True)
    said = own.places_m(CORRECTION.q_m[None], np.full(1, OTHER.altitude_m))[0]
    assert other.place_m() == pytest.approx(said, abs=1e-6)
    assert own.common() is None
    common = other.common()
    assert common is not None
    assert np.trace(common.covariance) == pytest.approx(np.trace(CORRECTION.covariance))


@pytest.mark.parametrize("corrected", [False, True], ids=["own", "other"])
def test_what_is_open_of_ranges_is_common_to_all_plots_of_the_source(corrected: bool) -> None:
    """Of the own carrier too, whose frame is known; a source without ranges has none of it."""
    ranges, errors = declared(40.0, 2e-3), np.diag([9.0, 4.0, 1e-6, 40.0**2, 2e-3**2])
    errors[:3, :3] *= corrected
    seen = replace(axes(corrected=corrected), unsure=Unsure(errors, {"radar": (3, ranges)}))
    radar, camera = seen.common("b/1", "radar"), seen.common("b/1", "camera")
    assert radar is not None
    assert camera is not None
    assert (radar.ranges, camera.ranges) == (3, 0)
    for common in (radar, camera):
        np.testing.assert_allclose(np.diag(common.covariance)[3:], np.diag(errors)[3:])
    place = seen.place_m() + np.array([3_000.0, 4_000.0])
    by = radar.displaces(np.array([*place, 0.0, 0.0])[:, None, None])[..., 0, 0]
    np.testing.assert_allclose(by[:, 3:], [[0.6, 3_000.0], [0.8, 4_000.0]])
    assert seen.ranges("radar") is ranges
    assert seen.ranges("camera").none
