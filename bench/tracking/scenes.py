"""Scenes for trackers: three moving carriers over a box of turning, appearing, vanishing targets.

A scene file (`scene_*.npz`) counts angles counter-clockwise from x, bearings from the carrier's
heading; here all is turned to bearings clockwise from north. `drawn` makes scenes of the same
statistics at any size.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, Indices
from estimation.frames import wrap_pi
from estimation.tracking.features import Layout, Said

CARRIERS = 3
_SCANS_EACH = 30
_PERIOD_S = 2.0
_CLASS_MEAN = np.array([0.0, 2.0, 4.0, 6.0])
_CLASS_SIGMA = 0.7
_RIGHT_CLASS = 0.85
_FEATURE_RANGE = (-2.0, 8.0)  # of false plots
_BIAS = np.array([[0.0, 0.0, 0.0], [420.0, -310.0, 0.9], [-350.0, 260.0, -1.2]])  # m, m, deg


class Sensors(NamedTuple):
    """What is the same for all sensors of a scene."""

    detection: float
    sigma_range_m: float
    sigma_bearing_rad: float
    clutter: float  # false plots a scan
    box_m: float


class Seen(NamedTuple):
    """The plots of one scan; `truth` is the row of the target, -1 false: for scoring only."""

    bearing_rad: Array  # from the carrier's heading, clockwise
    range_m: Array
    truth: Indices
    feature: Array
    declared: Indices


class Scene(NamedTuple):
    """A scene of S scans of N targets.

    Attributes:
        sensors: of all carriers.
        t_s, carrier: (S,).
        pose: (S, 3) true east, north [m] and heading [rad, clockwise from north] of the carrier.
        reported: (S, 3) the same as the carrier believes it.
        seen: of each scan.
        truth: (S, N, 2) east, north [m]; alive: (S, N).
    """

    sensors: Sensors
    t_s: Array
    carrier: Indices
    pose: Array
    reported: Array
    seen: tuple[Seen, ...]
    truth: Array
    alive: NDArray[np.bool_]


class Size(NamedTuple):
    """How large a drawn scene is, and how blunt its bearings are."""

    targets: int
    box_m: float = 100_000.0
    scans: int = CARRIERS * _SCANS_EACH
    sigma_bearing_rad: float = 0.0026


def read(path: Path) -> Scene:
    """The scene of a file."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    meta = json.loads(str(arrays["meta"]))
    sensors = Sensors(meta["pd"], meta["sigma_r"], meta["sigma_b"], meta["clutter"], meta["box"])
    scans = range(len(arrays["scan_t"]))
    return Scene(
        sensors,
        arrays["scan_t"],
        arrays["scan_carrier"].astype(np.intp),
        _clockwise(arrays["pose"]),
        _clockwise(arrays["pose_nav"]),
        tuple(_read_scan(arrays, np.flatnonzero(arrays["det_scan"] == k)) for k in scans),
        arrays["truth"].astype(float),
        arrays["alive"],
    )


def drawn(rng: np.random.Generator, size: Size) -> Scene:
    """A scene of the statistics of the files: the same sensors, motions and share of clutter."""
    sensors = Sensors(0.9, 30.0, size.sigma_bearing_rad, size.targets / 10, size.box_m)
    index = np.arange(size.scans)
    t_s = np.asarray(index * (_PERIOD_S / CARRIERS), dtype=float)
    carrier = index % CARRIERS
    pose = _poses(t_s, carrier, size.box_m)
    bias = _BIAS * [1.0, 1.0, -np.pi / 180]
    truth, alive = _motions(rng, size, t_s)
    category = rng.integers(len(_CLASS_MEAN), size=size.targets)
    seen = tuple(
        _scan(rng, sensors, pose[k], truth[k], np.flatnonzero(alive[k]), category) for k in index
    )
    return Scene(sensors, t_s, carrier, pose, pose + bias[carrier], seen, truth, alive)


def evidence(seen: Seen) -> Array:
    """Likelihood (4, m) of each plot's feature and declared class, over that of a false plot."""
    z = (seen.feature - _CLASS_MEAN[:, None]) / _CLASS_SIGMA
    density = np.exp(-(z**2) / 2) / (_CLASS_SIGMA * np.sqrt(2 * np.pi))
    width = _FEATURE_RANGE[1] - _FEATURE_RANGE[0]
    wrong = (1 - _RIGHT_CLASS) / len(_CLASS_MEAN)
    named = np.where(seen.declared == np.arange(len(_CLASS_MEAN))[:, None], _RIGHT_CLASS, 0.0)
    stated: Array = density * width * (named + wrong) * len(_CLASS_MEAN)
    return stated


FEATURES = Layout(1, (len(_CLASS_MEAN),))
"""The same as a number and a word, of which nothing is known beforehand."""


def said(seen: Seen) -> Said:
    """What the plots say, when nobody knows how classes and numbers go together."""
    value = seen.feature[None]
    wrong = (1 - _RIGHT_CLASS) / len(_CLASS_MEAN)
    named = np.where(seen.declared == np.arange(len(_CLASS_MEAN))[:, None], _RIGHT_CLASS, 0.0)
    likelihood = (named + wrong) * len(_CLASS_MEAN)
    width = np.array([_FEATURE_RANGE[1] - _FEATURE_RANGE[0]])
    return Said(value, np.full_like(value, _CLASS_SIGMA**2), likelihood, width, FEATURES)


def _read_scan(arrays: dict[str, NDArray[Any]], rows: Indices) -> Seen:
    return Seen(
        -arrays["det_bearing"][rows].astype(float),
        arrays["det_range"][rows].astype(float),
        arrays["det_truth"][rows].astype(np.intp),
        arrays["det_feat"][rows, 0].astype(float),
        arrays["det_cls"][rows].astype(np.intp),
    )


def _clockwise(pose: NDArray[Any]) -> Array:
    """x, y and a heading from x counter-clockwise, as east, north and a heading from north."""
    return np.column_stack([pose[:, :2], np.pi / 2 - pose[:, 2]])


def _poses(t_s: Array, carrier: Indices, box_m: float) -> Array:
    """Three carriers: at a corner and drifting, on a circle, crossing."""
    t, size = t_s[:, None], box_m / 100e3
    still = np.column_stack([-3e4 + 10 * t, -3e4 + 6 * t, 1.17 - 0.005 * t])
    angle = -0.005 * t
    circling = np.column_stack(
        [35e3 - 5e3 * (1 - np.cos(angle)), -2e4 + 13 * t, -0.627 + 0.0035 * t]
    )
    crossing = np.column_stack([35.0 * t, 4e4 - 180.0 * t, 3.065 - 0.0044 * t])
    pose: Array = np.stack([still, circling, crossing])[carrier, np.arange(len(t_s))]
    return pose * [size, size, 1.0]


def _motions(rng: np.random.Generator, size: Size, t_s: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Places (S, N, 2) and lives (S, N): a quarter turn once, a tenth appears, a tenth vanishes."""
    n, dt = size.targets, t_s[1] - t_s[0]
    place = rng.uniform(-size.box_m / 2, size.box_m / 2, (n, 2))
    course, speed = rng.uniform(0, 2 * np.pi, n), rng.uniform(50, 300, n)
    velocity = speed[:, None] * np.stack([np.sin(course), np.cos(course)], axis=-1)
    rate = np.radians(rng.uniform(2, 4, n)) * rng.choice([-1, 1], n) * (rng.random(n) < 0.25)
    begin = rng.uniform(10, 34, n)
    end = begin + rng.uniform(8, 14, n)
    truth = np.empty((len(t_s), n, 2))
    for k, t in enumerate(t_s):
        truth[k] = place
        angle = np.where((t >= begin) & (t < end), rate * dt, 0.0)
        sin, cos = np.sin(angle), np.cos(angle)
        east, north = velocity.T
        velocity = np.stack([cos * east + sin * north, cos * north - sin * east], axis=-1)
        velocity += rng.normal(0, 0.6 * np.sqrt(dt), (n, 2))
        place = place + velocity * dt
    kind, start, stop = rng.random(n), rng.uniform(10, 30, n), rng.uniform(30, 50, n)
    alive = np.ones((len(t_s), n), dtype=bool)
    alive &= (kind >= 0.1) | (t_s[:, None] >= start)
    alive &= (kind < 0.9) | (t_s[:, None] < stop)
    return truth, alive


def _scan(
    rng: np.random.Generator,
    sensors: Sensors,
    pose: Array,
    truth: Array,
    alive: Indices,
    category: Indices,
) -> Seen:
    """Plots of the living and false ones, shuffled."""
    hit = alive[rng.random(len(alive)) < sensors.detection]
    false = rng.poisson(sensors.clutter)
    ghosts = rng.uniform(-sensors.box_m / 2, sensors.box_m / 2, (false, 2))
    away = np.concatenate([truth[hit], ghosts]) - pose[:2]
    order = rng.permutation(len(away))
    real = np.arange(len(away)) < len(hit)
    noise = rng.normal(size=(2, len(away))) * real
    bearing = np.arctan2(*away.T) - pose[2] + noise[0] * sensors.sigma_bearing_rad
    far = np.hypot(*away.T) + noise[1] * sensors.sigma_range_m
    which = np.concatenate([category[hit], rng.integers(len(_CLASS_MEAN), size=false)])
    measured = rng.normal(_CLASS_MEAN[which], _CLASS_SIGMA)
    feature = np.where(real, measured, rng.uniform(*_FEATURE_RANGE, len(away)))
    named = real & (rng.random(len(away)) < _RIGHT_CLASS)
    declared = np.where(named, which, rng.integers(len(_CLASS_MEAN), size=len(away)))
    owner = np.concatenate([hit, np.full(false, -1)])
    return Seen(wrap_pi(bearing)[order], far[order], owner[order], feature[order], declared[order])


def instants(scene: Scene, from_s: float = 0.0) -> Iterator[int]:
    """Scans from a time on."""
    return (k for k, t in enumerate(scene.t_s) if t >= from_s)
