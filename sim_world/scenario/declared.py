"""The declared part of a scenario: what its file says, less the truth, as wire messages."""

from __future__ import annotations

from datetime import UTC, datetime
from math import floor, radians

from schemas.messages import (
    DeclaredCarrier,
    DeclaredScenario,
    FeatureInfo,
    Origin,
    Sector,
    SourceProperties,
)

from .file import Carrier, ScenarioFile, Sensor

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
        fusion=file.fusion,
    )


def unix_ns(instant: datetime) -> int:
    """Unix nanoseconds of an instant, exact to its microseconds."""
    since = instant - datetime(1970, 1, 1, tzinfo=UTC)
    return ((since.days * 86400 + since.seconds) * 1_000_000 + since.microseconds) * 1000


def _carrier(file: ScenarioFile, carrier: Carrier) -> DeclaredCarrier:
    return DeclaredCarrier(
        name=carrier.name,
        sigma_position_m=carrier.navigation.sigma_position_m,
        sigma_north_rad=radians(carrier.navigation.sigma_north_deg),
        sigma_clock_s=carrier.navigation.sigma_clock_s,
        sources={sensor.name: properties(file, sensor) for sensor in carrier.sensors},
        use_corrections=carrier.use_corrections,
    )


def properties(file: ScenarioFile, sensor: Sensor) -> SourceProperties:
    """What a sensor declares of itself."""
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
    if sensor.classes:
        names = [c.name for c in file.classes]
        features[CLASS_FEATURE] = FeatureInfo(
            kind="parametric",
            categories=names,
            confusion=confusion(len(names), sensor.classes.accuracy),
        )
    return features


def confusion(count: int, accuracy: float) -> list[list[float]]:
    """Row i: probabilities of reporting each of `count` classes when i is true."""
    if count == 1:
        return [[1.0]]
    other = (1 - accuracy) / (count - 1)
    return [[accuracy if i == j else other for j in range(count)] for i in range(count)]
