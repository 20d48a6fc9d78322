"""The columns of a carrier's reports: plots as measured, or the tracks a radar makes of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from estimation.arrays import Array
from schemas.messages import FeatureColumn, Increment, TrackFilter
from sim_world.logs import Logs
from sim_world.sensors import Sensor
from sim_world.tracking_radar import TrackReport


def plot_columns(sensor: Sensor, logs: Logs) -> dict[str, Any]:
    """The columns of a report of plots; a report of nothing has none."""
    if not len(logs.bearing_rad):
        return {}
    return {
        "time_offset_s": _list(logs.time_offset_s),
        **_measured("bearing_rad", logs.bearing_rad, sensor.declared.sigma_bearing_rad),
        **_measured("range_m", logs.range_m, sensor.declared.sigma_range_m),
        **_measured("elevation_rad", logs.elevation_rad, sensor.declared.sigma_elevation_rad),
        **_descriptions(sensor, logs),
    }


def track_columns(sensor: Sensor, logs: Logs, tracks: TrackReport) -> dict[str, Any]:
    """The columns of a report of tracks, each with what its newest plot says of the target."""
    if not len(tracks.number):
        return {}
    logs = logs.take(tracks.row)
    return {
        "track_id": [f"t{number}" for number in tracks.number.tolist()],
        "time_offset_s": _list(logs.time_offset_s),
        "east_m": tracks.state[:, 0].tolist(),
        "north_m": tracks.state[:, 1].tolist(),
        "covariance_position": _triangles(tracks.covariance[:, :2, :2]),
        "velocity_east_mps": tracks.state[:, 2].tolist(),
        "velocity_north_mps": tracks.state[:, 3].tolist(),
        "covariance_velocity": _triangles(tracks.covariance[:, 2:, 2:]),
        **_learnt(sensor, tracks),
        **_descriptions(sensor, logs),
    }


def _learnt(sensor: Sensor, tracks: TrackReport) -> dict[str, Any]:
    """The filters behind the tracks, or what they have learnt since the last report."""
    tracking = sensor.table.tracking
    if tracking and tracking.report == "increment":
        gained = [
            Increment(frame="carrier", y=vector, information=information)
            for vector, information in zip(
                tracks.vector.tolist(), _triangles(tracks.information), strict=True
            )
        ]
        return {"kind": ["increment"] * len(gained), "increment": gained}
    filters = [
        TrackFilter(
            model="constant_velocity",
            q=tracking.process_noise if tracking else 0.0,
            previous_t_ns=before,
            state=state,
            covariance=covariance,
        )
        for before, state, covariance in zip(
            tracks.before_ns.tolist(),
            tracks.state.tolist(),
            _triangles(tracks.covariance),
            strict=True,
        )
    ]
    return {"kind": ["track"] * len(filters), "filter": filters}


def _triangles(matrices: Array) -> list[list[float]]:
    """Upper triangles, row by row, of (n, k, k)."""
    rows, columns = np.triu_indices(matrices.shape[-1])
    triangles: list[list[float]] = matrices[:, rows, columns].tolist()
    return triangles


def _descriptions(sensor: Sensor, logs: Logs) -> dict[str, Any]:
    """What the logs say of their targets besides where they are."""
    return {
        **_identities(sensor, logs),
        **_classes(sensor, logs),
        "features": _features(sensor, logs),
    }


def _measured(name: str, column: Array | None, sigma: float | None) -> dict[str, Any]:
    if column is None:
        return {}
    return {name: column.tolist(), f"sigma_{name}": [sigma] * len(column)}


def _identities(sensor: Sensor, logs: Logs) -> dict[str, Any]:
    names = _list(logs.identity) or []
    if not any(names):
        return {}
    kinds = [name and sensor.table.identity_kind for name in names]
    return {"identity": names, "identity_kind": kinds}


def _classes(sensor: Sensor, logs: Logs) -> dict[str, Any]:
    if logs.classes is None or sensor.table.classes is None:
        return {}
    told = [None if name is None else [name] for name in logs.classes]
    accuracy = sensor.table.classes.accuracy
    return {"classes": told, "class_confidence": [t and accuracy for t in told]}


def _features(sensor: Sensor, logs: Logs) -> dict[str, FeatureColumn]:
    numbers = {
        f.name: FeatureColumn(
            values=[None if np.isnan(value) else value for value in logs.features[f.name].tolist()],
            sigmas=[f.sigma] * len(logs.bearing_rad),
        )
        for f in sensor.table.features
    }
    words = {w.name: FeatureColumn(values=logs.words[w.name].tolist()) for w in sensor.table.words}
    return {**numbers, **words}


def _list(column: np.ndarray | None) -> list[Any] | None:
    return None if column is None else column.tolist()
