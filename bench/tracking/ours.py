"""Our tracker on a scene."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from bench.tracking.scenes import Scene, evidence
from estimation.arrays import Array, Indices
from estimation.tracking.measurements import polar
from estimation.tracking.scan import Scan, View
from estimation.tracking.tracker import Picture, Settings, nothing, number, shown, step
from estimation.tracking.undetected import Region


class Snapshot(NamedTuple):
    """What was shown after a scan."""

    identity: Indices
    place_m: Array
    number: float


class Run(NamedTuple):
    """A scene tracked: what was shown after each scan, CPU seconds of each scan, the end."""

    shown: tuple[Snapshot, ...]
    cpu_s: Array
    picture: Picture | None


def settings_for(scene: Scene) -> Settings:
    """The defaults, on the region of the scene and a tenth more."""
    return Settings(region=Region((0.0, 0.0), 0.55 * scene.sensors.box_m, 22))


def scans_of(scene: Scene, poses: Array, features: bool = False) -> list[Scan]:
    """The scene's scans in the picture frame, as carriers at `poses` (S, 3) see it."""
    return [
        scan_of(scene, k, pose, evidence(scene.seen[k]) if features else None)
        for k, pose in enumerate(poses)
    ]


def run(scans: Iterable[Scan], settings: Settings) -> Run:
    """Track, with the CPU time of each step."""
    picture, every, cpu = nothing(settings, 0), [], []
    for scan in scans:
        begin = time.process_time()
        picture, _ = step(picture, scan, settings)
        found = shown(picture, settings)
        cpu.append(time.process_time() - begin)
        every.append(Snapshot(found.identity, found.mean[:, :2], number(picture).mean))
    return Run(tuple(every), np.array(cpu), picture)


def scan_of(scene: Scene, k: int, pose: Array, features: Array | None = None) -> Scan:
    """Scan k in the picture frame, as a carrier at `pose` (3,) sees it."""
    sensors, seen = scene.sensors, scene.seen[k]
    bearing = seen.bearing_rad + pose[2]
    plots = polar(pose[:2], bearing, seen.range_m, sensors.sigma_bearing_rad, sensors.sigma_range_m)
    return Scan(
        t_ns=round(scene.t_s[k] * 1e9),
        plots=plots,
        view=View(pose[:2]),
        detection=sensors.detection,
        clutter=sensors.clutter / sensors.box_m**2,
        evidence=features,
    )
