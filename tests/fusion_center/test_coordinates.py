"""Where logs put their targets: every coordinate gives one place, its covariance the scatter."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from estimation.frames import Site, geodetic_from_enu, on_surface
from fusion_center.sources.coordinates import Observer, Places, places
from schemas.messages import SourceProperties, SourceReport

SHIP = Site(0.7, 0.5, 20.0)
EAST_NORTH = np.array([[12_000.0, -5_000.0], [-800.0, 15_000.0], [30_000.0, 22_000.0]])
N = len(EAST_NORTH)
NO_DEFAULTS = SourceProperties()


def read(
    properties: SourceProperties = NO_DEFAULTS, altitude_m: float = 0.0, **columns: Any
) -> Places:
    report = SourceReport(carrier="a", boot="x", stream="radar", seq=1, t_ns=1, **columns)
    still = Observer(SHIP, np.zeros((len(report), 2)))
    return places(report, properties, still, altitude_m)


def polar(altitude_m: float = 0.0) -> tuple[list[float], list[float], list[float]]:
    """Bearing, slant range and elevation of the targets at an altitude."""
    enu = on_surface(SHIP, *EAST_NORTH.T, altitude_m)
    slant = np.linalg.norm(enu, axis=1)
    bearing = np.arctan2(enu[:, 0], enu[:, 1])
    return bearing.tolist(), slant.tolist(), np.arcsin(enu[:, 2] / slant).tolist()


def test_bearing_range_geodetic_and_cartesian_agree() -> None:
    bearing, slant, _ = polar()
    latitude, longitude, _ = geodetic_from_enu(SHIP, on_surface(SHIP, *EAST_NORTH.T))
    from_polar = read(bearing_rad=bearing, range_m=slant)
    geodetic = read(latitude_rad=latitude.tolist(), longitude_rad=longitude.tolist())
    cartesian = read(east_m=EAST_NORTH[:, 0].tolist(), north_m=EAST_NORTH[:, 1].tolist())
    for found in (from_polar, geodetic, cartesian):
        np.testing.assert_allclose(found.east_north_m, EAST_NORTH, atol=1e-3)
        np.testing.assert_allclose(found.altitude_m, 0.0, atol=1e-3)


def test_elevation_gives_the_altitude() -> None:
    bearing, slant, elevation = polar(3000.0)
    found = read(bearing_rad=bearing, range_m=slant, elevation_rad=elevation)
    np.testing.assert_allclose(found.east_north_m, EAST_NORTH, atol=1e-3)
    np.testing.assert_allclose(found.altitude_m, 3000.0, atol=0.01)  # frames: 1.5e-6 of it
    level = read(altitude_m=3000.0, bearing_rad=bearing, range_m=slant)
    np.testing.assert_allclose(level.east_north_m, EAST_NORTH, atol=1e-3)


@pytest.mark.parametrize("elevated", [False, True])
def test_covariance_is_the_scatter_of_the_places(elevated: bool) -> None:
    """3000 draws: variances come out within 4 * sqrt(2 / 3000), 10 %."""
    bearing, slant, elevation = (values[:1] * 3000 for values in polar(8000.0))
    sigmas = 2e-3, 40.0, 3e-3
    rng = np.random.default_rng(5)
    noisy = [
        (np.array(values) + rng.normal(0, sigma, 3000)).tolist()
        for values, sigma in zip((bearing, slant, elevation), sigmas, strict=True)
    ]
    more = {"elevation_rad": noisy[2], "sigma_elevation_rad": [sigmas[2]] * 3000}
    found = read(
        altitude_m=8000.0,
        bearing_rad=noisy[0],
        range_m=noisy[1],
        sigma_bearing_rad=[sigmas[0]] * 3000,
        sigma_range_m=[sigmas[1]] * 3000,
        **(more if elevated else {}),
    )
    scatter = np.cov(found.east_north_m.T)
    stated = found.covariance.mean(axis=0)
    whitened = np.linalg.solve(stated, scatter)
    np.testing.assert_allclose(np.linalg.eigvals(whitened), 1.0, atol=0.1)


@pytest.mark.parametrize("aside_m", [0.0, 100.0, 300.0, 600.0, 1500.0])
@pytest.mark.parametrize("elevated", [False, True])
def test_a_place_straight_below_a_target_is_as_unsure_as_it_errs(
    aside_m: float, elevated: bool
) -> None:
    """Where slant range says next to nothing of level range; 2000 draws.

    Errors are one-sided there, so their mean square is not the variance, but of its order.
    """
    rng = np.random.default_rng(3)
    enu = on_surface(SHIP, aside_m * 0.6, aside_m * 0.8, 3000.0)
    true_slant = float(np.linalg.norm(enu))
    columns: dict[str, Any] = {
        "bearing_rad": (np.arctan2(enu[0], enu[1]) + rng.normal(0, 5e-3, 2000)).tolist(),
        "range_m": rng.normal(true_slant, 40.0, 2000).tolist(),
        "sigma_bearing_rad": [5e-3] * 2000,
        "sigma_range_m": [40.0] * 2000,
    }
    if elevated:
        tilt = np.arcsin(enu[2] / true_slant) + rng.normal(0, 4e-3, 2000)
        columns["elevation_rad"] = np.minimum(tilt, np.pi / 2).tolist()
        columns["sigma_elevation_rad"] = [4e-3] * 2000
    found = read(altitude_m=3000.0, **columns)
    assert found.located.all()
    errors = found.east_north_m - enu[:2]
    squares = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(found.covariance), errors) / 2
    assert 0.2 < squares.mean() < 1.6


def test_a_full_covariance_comes_before_sigmas() -> None:
    bearing, slant, _ = polar()
    whole = read(
        bearing_rad=bearing,
        range_m=slant,
        covariance_polar=[[1e-6, 0.0, 900.0]] * N,
        sigma_range_m=[5.0] * N,
    )
    sigmas = read(
        bearing_rad=bearing,
        range_m=slant,
        sigma_bearing_rad=[1e-3] * N,
        sigma_range_m=[30.0] * N,
    )
    np.testing.assert_allclose(whole.covariance, sigmas.covariance)
    assert not whole.defaulted.any()


def test_a_position_covariance_comes_as_it_is() -> None:
    found = read(
        east_m=[1.0, 2.0],
        north_m=[3.0, 4.0],
        covariance_position=[[4.0, 1.0, 9.0], None],
        sigma_position_m=[None, 5.0],
    )
    np.testing.assert_array_equal(found.covariance[0], [[4, 1], [1, 9]])
    np.testing.assert_array_equal(found.covariance[1], 25 * np.eye(2))


def test_missing_sigmas_are_the_sources_and_counted() -> None:
    bearing, slant, _ = polar()
    properties = SourceProperties(sigma_bearing_rad=1e-3, sigma_range_m=30.0)
    found = read(
        properties,
        bearing_rad=bearing,
        range_m=slant,
        sigma_bearing_rad=[2e-3] * N,
        sigma_range_m=[40.0, None, 40.0],
    )
    assert found.defaulted.tolist() == [False, True, False]
    assert found.usable.all()
    along = EAST_NORTH[1] / np.linalg.norm(EAST_NORTH[1])
    assert along @ found.covariance[1] @ along == pytest.approx(30.0**2, rel=1e-4)


def test_without_a_sigma_anywhere_a_log_is_located_but_not_usable() -> None:
    bearing, slant, _ = polar()
    found = read(
        bearing_rad=bearing,
        range_m=slant,
        sigma_bearing_rad=[2e-3] * N,
        sigma_range_m=[40.0, None, 40.0],
    )
    assert found.located.all()
    assert found.usable.tolist() == [True, False, True]


def test_a_bearing_alone_is_no_place() -> None:
    found = read(bearing_rad=[0.1, 0.2], range_m=[None, 1000.0], sigma_bearing_rad=[1e-3] * 2)
    assert found.located.tolist() == [False, True]
    assert not read(bearing_rad=[0.1]).located.any()
    assert len(read().located) == 0


def test_each_log_is_read_from_what_it_has() -> None:
    found = read(
        bearing_rad=[0.0, None],
        range_m=[1000.0, None],
        sigma_bearing_rad=[1e-3, None],
        sigma_range_m=[10.0, None],
        east_m=[None, 700.0],
        north_m=[None, 300.0],
        sigma_position_m=[None, 20.0],
    )
    np.testing.assert_allclose(found.east_north_m, [[0, 999.8], [700, 300]], atol=0.01)
    assert found.usable.all()
    assert not found.defaulted.any()


def test_a_geodetic_log_is_placed_from_where_the_carrier_was_at_the_log() -> None:
    latitude, longitude, _ = geodetic_from_enu(SHIP, on_surface(SHIP, *EAST_NORTH.T))
    report = SourceReport(
        carrier="a",
        boot="x",
        stream="ais",
        seq=1,
        t_ns=1,
        latitude_rad=latitude.tolist(),
        longitude_rad=longitude.tolist(),
    )
    moved = np.tile([30.0, -10.0], (N, 1))
    found = places(report, NO_DEFAULTS, Observer(SHIP, moved), 0.0)
    np.testing.assert_allclose(found.east_north_m, EAST_NORTH - moved, atol=1e-3)
