"""What a sensor of a carrier reports: true geometry, then systematic errors, then noise."""

from __future__ import annotations

from math import radians
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.frames import wrap_pi
from schemas.messages import FeatureInfo

from .features import actual_accuracy, any_word, numbers, of_nobody, purposes, words
from .logs import Logs
from .noise import TargetDraws, generator, normal
from .scenario.declared import CLASS_FEATURE, plot_properties, properties
from .scenario.file import ScenarioFile
from .scenario.file import Sensor as SensorTable
from .scene import TURN_RAD, Polar, Stand, Targets, polar
from .schedule import Look, looks


class SystematicErrors(NamedTuple):
    """The actual errors of a sensor, constant over a run."""

    range_bias_m: float
    range_scale: float
    azimuth_bias_rad: float
    clock_s: float


class _Draws(NamedTuple):
    """The draws (N, 2) of one look for N targets, by what they are for."""

    detection: Array
    polar: Array
    elevation: Array
    class_told: Array
    identity: Array
    told: dict[str, Array]

    def take(self, rows: np.ndarray) -> _Draws:
        """The draws of some of the targets."""
        return _Draws(
            self.detection[rows],
            self.polar[rows],
            self.elevation[rows],
            self.class_told[rows],
            self.identity[rows],
            {purpose: draw[rows] for purpose, draw in self.told.items()},
        )


class Sensor:
    """One source of a carrier; pure: the same look at the same truth gives the same logs."""

    def __init__(self, file: ScenarioFile, carrier: str, table: SensorTable) -> None:
        self.name, self.table = table.name, table
        self.declared, self.plots = properties(file, table), plot_properties(file, table)
        self.errors = systematic_errors(file, carrier, table)
        self._address = (file.seed, "sensor", carrier, table.name)
        self._draws = TargetDraws.of(*self._address)
        self._step_ns = round(file.time.step_s * 1e9)
        sector = self.plots.sector
        self._start_rad = sector.start_rad if sector else 0.0
        self._width_rad = sector.width_rad if sector else TURN_RAD

    def due(self, step: int) -> list[Look]:
        """The reports after the step before, up to this one."""
        table = self.table
        return looks(step, self._step_ns, period_s=table.period_s, phase_s=table.phase_s)

    def observe(self, look: Look, stand: Stand, targets: Targets) -> Logs:
        """The logs of one look, in order of their bearings."""
        after_s = look.after_step_ns * 1e-9
        true = polar(stand, targets.motion, after_s, after_s)
        offset_s = self._swept_s(true.bearing_rad)
        if self.table.rotating:
            true = polar(stand, targets.motion, after_s + offset_s, after_s)
        rows = self._in_view(true)
        true, draws = true.take(rows), self._draw(look, targets.number[rows])
        kept = self._detected(true, draws)
        rows = rows[kept]
        logs = self._measured(true.take(kept), targets.take(rows), offset_s[rows], draws.take(kept))
        if self.plots.clutter_per_scan > 0:
            logs = logs.join(self._clutter(look))
        return logs.take(np.argsort(logs.bearing_rad, kind="stable"))

    def _draw(self, look: Look, number: np.ndarray) -> _Draws:
        """All draws of one look; which identities it reads is settled once for all looks."""
        features = purposes(self.table)
        fixed = ["detection", "polar", "elevation", "class"]
        addresses = [(look.number, purpose) for purpose in [*fixed, *features]]
        detection, of_polar, elevation, told, *of_features, identity = self._draws.at(
            number, [*addresses, (0, "identity")]
        )
        by_purpose = dict(zip(features, of_features, strict=True))
        return _Draws(detection, of_polar, elevation, told, identity, by_purpose)

    def _swept_s(self, bearing_rad: Array) -> Array:
        """When the antenna, at own north at the time of the report, passed a bearing before."""
        return self.table.period_s * (bearing_rad / TURN_RAD - 1)

    def _in_view(self, true: Polar) -> np.ndarray:
        """Rows of the targets within range and sector."""
        limits = self.plots
        inside = (limits.range_min_m <= true.range_m) & (true.range_m <= limits.range_max_m)
        inside &= np.mod(true.bearing_rad - self._start_rad, TURN_RAD) <= self._width_rad
        return np.flatnonzero(inside)

    def _detected(self, true: Polar, draws: _Draws) -> np.ndarray:
        """Rows of those that are detected and not hidden by nearer ones."""
        rows = np.flatnonzero(draws.detection[:, 0] < self.plots.detection_probability)
        hidden = self.plots.resolution_bearing_rad > 0
        return rows[self._resolved(true.take(rows))] if hidden else rows

    def _resolved(self, true: Polar) -> np.ndarray:
        """Which targets have no nearer one within the resolution."""
        apart = wrap_pi(true.bearing_rad[:, None] - true.bearing_rad)
        further = true.range_m[:, None] - true.range_m
        hides = (np.abs(apart) <= self.plots.resolution_bearing_rad) & (further > 0)
        if self.plots.coordinates == "bearing_range":
            hides &= further <= self.plots.resolution_range_m
        return ~np.asarray(hides.any(axis=1))

    def _measured(self, true: Polar, targets: Targets, offset_s: Array, draws: _Draws) -> Logs:
        table, errors = self.table, self.errors
        noise = normal(draws.polar)
        bearing = true.bearing_rad + errors.azimuth_bias_rad
        bearing += radians(table.sigma_bearing_deg) * noise[:, 0]
        slant = true.range_m * (1 + errors.range_scale) + errors.range_bias_m
        slant += (table.sigma_range_m or 0.0) * noise[:, 1]
        tilt = radians(table.sigma_elevation_deg or 0.0) * normal(draws.elevation)[:, 0]
        return self._logs(
            Polar(np.mod(bearing, TURN_RAD), np.abs(slant), true.elevation_rad + tilt),
            offset_s,
            identity=self._identities(targets, draws),
            classes=self._classes(targets, draws),
            features=numbers(table, targets, draws.told),
            words=words(table, targets, draws.told),
        )

    def _logs(
        self,
        measured: Polar,
        offset_s: Array,
        *,
        identity: np.ndarray,
        classes: np.ndarray,
        features: dict[str, Array],
        words: dict[str, np.ndarray],
    ) -> Logs:
        """The columns that this sensor has."""
        table = self.table
        return Logs(
            bearing_rad=measured.bearing_rad,
            range_m=measured.range_m if table.coordinates == "bearing_range" else None,
            elevation_rad=measured.elevation_rad if table.sigma_elevation_deg else None,
            time_offset_s=offset_s if table.rotating else None,
            identity=identity if table.identity_share else None,
            classes=classes if table.classes else None,
            features=features,
            words=words,
        )

    def _identities(self, targets: Targets, draws: _Draws) -> np.ndarray:
        reads = draws.identity[:, 0] < self.table.identity_share
        return _where(reads & (targets.identity != ""), targets.identity)

    def _classes(self, targets: Targets, draws: _Draws) -> np.ndarray:
        """The true class with the sensor's accuracy, else another; none of a target without."""
        if self.table.classes is None:
            return np.full(len(targets.number), None)
        names = self._class_info().categories
        true = np.array([names.index(c) if c else 0 for c in targets.classes], dtype=int)
        u, v = draws.class_told.T
        other = (true + 1 + np.floor(v * (len(names) - 1)).astype(int)) % len(names)
        told = np.where(u < actual_accuracy(self.table.classes), true, other)
        return _where(targets.classes != "", np.array(names, dtype=object)[told])

    def _class_info(self) -> FeatureInfo:
        return self.plots.features[CLASS_FEATURE]

    def _clutter(self, look: Look) -> Logs:
        """False alarms, uniform over the covered area, in number after Poisson."""
        limits, table = self.plots, self.table
        rng = generator(*self._address, "clutter", look.number)
        count = int(rng.poisson(limits.clutter_per_scan))
        bearing = np.mod(self._start_rad + self._width_rad * rng.random(count), TURN_RAD)
        area = rng.uniform(limits.range_min_m**2, limits.range_max_m**2, count)
        tilt = radians(table.sigma_elevation_deg or 0.0) * rng.standard_normal(count)
        names = self._class_info().categories if table.classes else [""]
        return self._logs(
            Polar(bearing, np.sqrt(area), tilt),
            self._swept_s(bearing),
            identity=np.full(count, None),
            classes=np.array(names, dtype=object)[rng.integers(len(names), size=count)],
            features={f.name: of_nobody(f, rng, count) for f in table.features},
            words={w.name: any_word(w, rng, count) for w in table.words},
        )


def systematic_errors(file: ScenarioFile, carrier: str, table: SensorTable) -> SystematicErrors:
    """The errors given in the file, or drawn from their sigmas; all zero where disabled."""
    if not file.errors.enabled:
        return SystematicErrors(0.0, 0.0, 0.0, 0.0)
    sigmas = (
        table.sigma_range_bias_m,
        table.sigma_range_scale,
        table.sigma_azimuth_bias_deg,
        table.sigma_clock_s,
    )
    given = (
        table.errors.range_bias_m,
        table.errors.range_scale,
        table.errors.azimuth_bias_deg,
        table.errors.clock_s,
    )
    draws = generator(file.seed, "sensor", carrier, table.name, "errors").standard_normal(4)
    bias, scale, azimuth, clock = (
        float(sigma * draw) if value is None else value
        for sigma, draw, value in zip(sigmas, draws, given, strict=True)
    )
    return SystematicErrors(bias, scale, radians(azimuth), clock)


def _where(known: np.ndarray, names: np.ndarray) -> np.ndarray:
    """The names that are known, None for the others."""
    column = np.full(len(names), None)
    column[known] = names[known]
    return column
