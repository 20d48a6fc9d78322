"""What a sensor of a carrier reports: true geometry, then systematic errors, then noise."""

from __future__ import annotations

from math import radians
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.frames import wrap_pi
from schemas.messages import FeatureInfo

from .noise import TargetDraws, generator
from .scenario.declared import CLASS_FEATURE, properties
from .scenario.file import FeatureReports, ScenarioFile
from .scenario.file import Sensor as SensorTable
from .scene import TURN_RAD, Polar, Stand, Targets, polar


class Look(NamedTuple):
    """One report that is due: its number since the start, and when, after the step (<= 0)."""

    number: int
    after_step_ns: int


class SystematicErrors(NamedTuple):
    """The actual errors of a sensor, constant over a run."""

    range_bias_m: float
    range_scale: float
    azimuth_bias_rad: float
    clock_s: float


class Logs(NamedTuple):
    """L target logs as columns; None = the sensor does not measure that.

    Attributes:
        classes: reported class and how likely it is the right one.
        features: name -> values, NaN where a log has none.
    """

    bearing_rad: Array
    range_m: Array | None
    elevation_rad: Array | None
    time_offset_s: Array | None
    identity: np.ndarray | None
    classes: np.ndarray | None
    features: dict[str, Array]

    def take(self, rows: np.ndarray) -> Logs:
        """The same of some rows."""
        return self._replace(
            bearing_rad=self.bearing_rad[rows],
            range_m=_taken(self.range_m, rows),
            elevation_rad=_taken(self.elevation_rad, rows),
            time_offset_s=_taken(self.time_offset_s, rows),
            identity=_taken(self.identity, rows),
            classes=_taken(self.classes, rows),
            features={name: values[rows] for name, values in self.features.items()},
        )

    def join(self, other: Logs) -> Logs:
        """These and then those of the same sensor."""
        return Logs(
            bearing_rad=np.concatenate([self.bearing_rad, other.bearing_rad]),
            range_m=_joined(self.range_m, other.range_m),
            elevation_rad=_joined(self.elevation_rad, other.elevation_rad),
            time_offset_s=_joined(self.time_offset_s, other.time_offset_s),
            identity=_joined(self.identity, other.identity),
            classes=_joined(self.classes, other.classes),
            features={
                name: np.concatenate([values, other.features[name]])
                for name, values in self.features.items()
            },
        )


class Sensor:
    """One source of a carrier; pure: the same look at the same truth gives the same logs."""

    def __init__(self, file: ScenarioFile, carrier: str, table: SensorTable) -> None:
        self.name, self.table = table.name, table
        self.declared = properties(file, table)
        self.errors = systematic_errors(file, carrier, table)
        self._address = (file.seed, "sensor", carrier, table.name)
        self._draws = TargetDraws.of(*self._address)
        self._step_ns = round(file.time.step_s * 1e9)
        sector = self.declared.sector
        self._start_rad = sector.start_rad if sector else 0.0
        self._width_rad = sector.width_rad if sector else TURN_RAD

    def due(self, step: int) -> list[Look]:
        """The reports after the step before, up to this one."""
        period, phase = round(self.table.period_s * 1e9), round(self.table.phase_s * 1e9)
        now = step * self._step_ns
        first = max((now - self._step_ns - phase) // period + 1, 0)
        last = (now - phase) // period
        return [Look(n, phase + n * period - now) for n in range(first, last + 1)]

    def observe(self, look: Look, stand: Stand, targets: Targets) -> Logs:
        """The logs of one look, in order of their bearings."""
        after_s = look.after_step_ns * 1e-9
        true = polar(stand, targets.motion, after_s, after_s)
        offset_s = self._swept_s(true.bearing_rad)
        if self.table.rotating:
            true = polar(stand, targets.motion, after_s + offset_s, after_s)
        seen = self._seen(look, true, targets.number)
        logs = self._measured(look, true.take(seen), targets.take(seen), offset_s[seen])
        if self.declared.clutter_per_scan > 0:
            logs = logs.join(self._clutter(look))
        return logs.take(np.argsort(logs.bearing_rad, kind="stable"))

    def _swept_s(self, bearing_rad: Array) -> Array:
        """When the antenna, at own north at the time of the report, passed a bearing before."""
        return self.table.period_s * (bearing_rad / TURN_RAD - 1)

    def _seen(self, look: Look, true: Polar, number: np.ndarray) -> np.ndarray:
        """Rows of the targets within limits that are detected and not hidden by nearer ones."""
        limits = self.declared
        inside = (limits.range_min_m <= true.range_m) & (true.range_m <= limits.range_max_m)
        inside &= np.mod(true.bearing_rad - self._start_rad, TURN_RAD) <= self._width_rad
        rows = np.flatnonzero(inside)
        draws = self._draws.uniform(number[rows], look.number, "detection")
        rows = rows[draws[:, 0] < limits.detection_probability]
        return rows[self._resolved(true.take(rows))] if limits.resolution_bearing_rad else rows

    def _resolved(self, true: Polar) -> np.ndarray:
        """Which targets have no nearer one within the resolution."""
        apart = wrap_pi(true.bearing_rad[:, None] - true.bearing_rad)
        further = true.range_m[:, None] - true.range_m
        hides = (np.abs(apart) <= self.declared.resolution_bearing_rad) & (further > 0)
        if self.declared.coordinates == "bearing_range":
            hides &= further <= self.declared.resolution_range_m
        return ~np.asarray(hides.any(axis=1))

    def _measured(self, look: Look, true: Polar, targets: Targets, offset_s: Array) -> Logs:
        table, errors, n = self.table, self.errors, look.number
        noise = self._draws.normal(targets.number, n, "polar")
        bearing = true.bearing_rad + errors.azimuth_bias_rad
        bearing += radians(table.sigma_bearing_deg) * noise[:, 0]
        slant = true.range_m * (1 + errors.range_scale) + errors.range_bias_m
        slant += (table.sigma_range_m or 0.0) * noise[:, 1]
        elevation = true.elevation_rad + self._tilts(targets, n)
        return self._logs(
            Polar(np.mod(bearing, TURN_RAD), np.abs(slant), elevation),
            offset_s,
            identity=self._identities(targets),
            classes=self._classes(look, targets),
            features={
                f.name: targets.features[f.name]
                + f.sigma * self._draws.normal(targets.number, n, f"feature {f.name}")[:, 0]
                for f in table.features
            },
        )

    def _tilts(self, targets: Targets, report: int) -> Array | float:
        if self.table.sigma_elevation_deg is None:
            return 0.0
        draws = self._draws.normal(targets.number, report, "elevation")[:, 0]
        return radians(self.table.sigma_elevation_deg) * draws

    def _logs(
        self,
        measured: Polar,
        offset_s: Array,
        *,
        identity: np.ndarray,
        classes: np.ndarray,
        features: dict[str, Array],
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
        )

    def _identities(self, targets: Targets) -> np.ndarray:
        """Identities that it reads; which, is settled once for all reports."""
        reads = self._draws.uniform(targets.number, 0, "identity")[:, 0] < self.table.identity_share
        return _where(reads & (targets.identity != ""), targets.identity)

    def _classes(self, look: Look, targets: Targets) -> np.ndarray:
        """The true class with the sensor's accuracy, else another; none of a target without."""
        if self.table.classes is None:
            return np.full(len(targets.number), None)
        names = self._class_info().categories
        true = np.array([names.index(c) if c else 0 for c in targets.classes], dtype=int)
        u, v = self._draws.uniform(targets.number, look.number, "class").T
        other = (true + 1 + np.floor(v * (len(names) - 1)).astype(int)) % len(names)
        told = np.where(u < self.table.classes.accuracy, true, other)
        return _where(targets.classes != "", np.array(names, dtype=object)[told])

    def _class_info(self) -> FeatureInfo:
        return self.declared.features[CLASS_FEATURE]

    def _clutter(self, look: Look) -> Logs:
        """False alarms, uniform over the covered area, in number after Poisson."""
        limits, table = self.declared, self.table
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
            features={
                f.name: rng.uniform(*(f.population or (np.nan, np.nan)), count)
                for f in table.features
            },
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


def _population(feature: FeatureReports, rng: np.random.Generator, count: int) -> Array:
    """What false alarms show of a feature; nothing where its population is not declared."""
    return rng.uniform(*feature.population, count) if feature.population else np.full(count, np.nan)


def _where(known: np.ndarray, names: np.ndarray) -> np.ndarray:
    """The names that are known, None for the others."""
    column = np.full(len(names), None)
    column[known] = names[known]
    return column


def _taken(column: np.ndarray | None, rows: np.ndarray) -> np.ndarray | None:
    return None if column is None else column[rows]


def _joined(a: np.ndarray | None, b: np.ndarray | None) -> np.ndarray | None:
    return None if a is None or b is None else np.concatenate([a, b])
