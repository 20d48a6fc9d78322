"""The declared part of a scenario: what its file says, less the truth, as wire messages."""

from __future__ import annotations

from datetime import UTC, datetime
from math import floor, radians

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.frames import Site, geodetic_from_enu, on_surface
from schemas.messages import (
    DeclaredBeacon,
    DeclaredCarrier,
    DeclaredRanging,
    DeclaredScenario,
    FeatureInfo,
    Origin,
    Sector,
    SourceProperties,
)

from ..noise import generator
from ..tracking_radar import memory_s
from .file import Carrier, ScenarioFile, Sensor
from .ranging import Beacon, Ranging

CLASS_FEATURE = "class"
"""Name under which a source declares the confusion of the classes it reports."""


def declare(file: ScenarioFile) -> DeclaredScenario:
    """The declared part, in radians and nanoseconds."""
    step_ns = round(file.time.step_s * 1e9)
    return DeclaredScenario(
        name=file.name,
        title=file.title,
        origin=Origin(
            latitude_rad=radians(file.origin.latitude_deg),
            longitude_rad=radians(file.origin.longitude_deg),
            altitude_m=file.origin.altitude_m,
        ),
        epoch_ns=unix_ns(file.time.epoch),
        step_ns=step_ns,
        steps=floor(file.time.duration_s * 1e9 / step_ns + 1e-6),
        max_clock_error_s=file.time.max_clock_error_s,
        carriers=[_carrier(file, carrier) for carrier in file.carriers],
        beacons=[_beacon(file, beacon) for beacon in file.beacons],
        fusion=file.fusion,
    )


def unix_ns(instant: datetime) -> int:
    """Unix nanoseconds of an instant, exact to its microseconds."""
    since = instant - datetime(1970, 1, 1, tzinfo=UTC)
    return ((since.days * 86400 + since.seconds) * 1_000_000 + since.microseconds) * 1000


def _carrier(file: ScenarioFile, carrier: Carrier) -> DeclaredCarrier:
    prior = carrier.navigation
    return DeclaredCarrier(
        name=carrier.name,
        sigma_position_m=prior.sigma_position_m,
        sigma_north_rad=radians(prior.sigma_north_deg),
        sigma_clock_s=prior.sigma_clock_s,
        sigma_clock_drift=prior.sigma_clock_drift_ppm * 1e-6,
        sigma_north_drift_rad_per_sqrt_s=radians(prior.sigma_north_drift_deg_per_sqrt_h) / 60,
        sigma_speed_mps=prior.sigma_speed_mps,
        sigma_current_mps=prior.sigma_current_mps,
        sigma_log_noise_mps=prior.sigma_log_noise_mps,
        sigma_compass_noise_rad=radians(prior.sigma_compass_noise_deg),
        sources={sensor.name: properties(file, sensor) for sensor in carrier.sensors},
        ranging=[_ranging(table) for table in carrier.ranging],
        use_corrections=carrier.use_corrections,
    )


def _ranging(table: Ranging) -> DeclaredRanging:
    return DeclaredRanging(
        kind=table.kind,
        to=table.to,
        period_s=table.period_s,
        sigma_m=table.sigma_m,
        sigma_range_bias_m=table.sigma_range_bias_m,
        sigma_range_scale=table.sigma_range_scale,
        sigma_clock_m=table.sigma_clock_m,
        sigma_clock_drift_mps=table.sigma_clock_drift_mps,
    )


def origin_of(file: ScenarioFile) -> Site:
    """Where the axes of a scenario touch the ellipsoid."""
    origin = file.origin
    return Site(radians(origin.latitude_deg), radians(origin.longitude_deg), origin.altitude_m)


def beacon_place_m(file: ScenarioFile, beacon: Beacon) -> Array:
    """Where a beacon truly is (3,), in the axes of the scenario's origin."""
    return on_surface(origin_of(file), beacon.east_m, beacon.north_m, beacon.altitude_m)


def beacon_error(file: ScenarioFile, beacon: Beacon) -> Array:
    """Declared less true place (3,) of a beacon, as given in the file or drawn from its sigmas."""
    given = (beacon.errors.east_m, beacon.errors.north_m, beacon.errors.up_m)
    sigmas = (beacon.sigma_position_m, beacon.sigma_position_m, beacon.sigma_altitude_m)
    draws = generator(file.seed, "beacon", beacon.name, "errors").standard_normal(3)
    error = [
        sigma * draw if value is None else value
        for sigma, draw, value in zip(sigmas, draws, given, strict=True)
    ]
    return np.array(error) * file.errors.enabled


def _beacon(file: ScenarioFile, beacon: Beacon) -> DeclaredBeacon:
    declared = beacon_place_m(file, beacon) + beacon_error(file, beacon)
    latitude, longitude, altitude = geodetic_from_enu(origin_of(file), declared)
    return DeclaredBeacon(
        name=beacon.name,
        latitude_rad=float(latitude),
        longitude_rad=float(longitude),
        altitude_m=float(altitude),
        sigma_position_m=beacon.sigma_position_m,
        sigma_altitude_m=beacon.sigma_altitude_m,
    )


def properties(file: ScenarioFile, sensor: Sensor) -> SourceProperties:
    """What a sensor declares of itself."""
    plots = plot_properties(file, sensor)
    if sensor.tracking is None:
        return plots
    memory = memory_s(plots, sensor.tracking.process_noise)
    return replace(plots, coordinates="cartesian", sends_tracks=True, filter_memory_s=memory)


def plot_properties(file: ScenarioFile, sensor: Sensor) -> SourceProperties:
    """The same of the plots of a sensor, which it may keep to itself and send tracks."""
    return SourceProperties(
        kind=sensor.kind,
        coordinates=sensor.coordinates,
        period_s=sensor.period_s,
        sigma_bearing_rad=radians(sensor.sigma_bearing_deg),
        sigma_range_m=sensor.sigma_range_m,
        sigma_elevation_rad=sensor.sigma_elevation_deg and radians(sensor.sigma_elevation_deg),
        detection_probability=sensor.detection_probability,
        clutter_per_scan=sensor.clutter_per_scan,
        range_min_m=sensor.range_min_m,
        range_max_m=sensor.range_max_m,
        sector=sensor.sector_deg and _sector(*sensor.sector_deg),
        resolution_bearing_rad=radians(sensor.resolution_bearing_deg),
        resolution_range_m=sensor.resolution_range_m,
        sigma_range_bias_m=sensor.sigma_range_bias_m,
        sigma_range_scale=sensor.sigma_range_scale,
        sigma_azimuth_bias_rad=radians(sensor.sigma_azimuth_bias_deg),
        sigma_clock_s=sensor.sigma_clock_s,
        features=_features(file, sensor),
    )


def _sector(start_deg: float, width_deg: float) -> Sector:
    return Sector(start_rad=radians(start_deg), width_rad=radians(width_deg))


def _features(file: ScenarioFile, sensor: Sensor) -> dict[str, FeatureInfo]:
    features = {
        f.name: FeatureInfo(
            kind=f.kind,
            unit=f.unit,
            sigma=f.sigma,
            population=f.population and list(f.population),
        )
        for f in sensor.features
    }
    features |= {
        w.name: FeatureInfo(
            kind=w.kind,
            categories=w.categories,
            confusion=confusion(len(w.categories), w.accuracy),
        )
        for w in sensor.words
    }
    if sensor.classes:
        names = [c.name for c in file.classes]
        features[CLASS_FEATURE] = FeatureInfo(
            kind="parametric",
            categories=names,
            confusion=confusion(len(names), sensor.classes.accuracy),
        )
    return features


def confusion(count: int, accuracy: float) -> list[list[float]]:
    """Row i: probabilities of reporting each of `count` names when i is true."""
    if count == 1:
        return [[1.0]]
    other = (1 - accuracy) / (count - 1)
    return [[accuracy if i == j else other for j in range(count)] for i in range(count)]
