"""The truth of a run, step by step: a pure function of the scenario and the step."""

from __future__ import annotations

import numpy as np

from schemas.messages import TruthCarriers, TruthTargets

from .motion import Kinematics, Path, Paths
from .navigation import sail
from .scenario import Scenario
from .scenario.checks import feature_names, word_names
from .scenario.declared import origin_of
from .scenario.file import Carrier, ScenarioFile
from .sensors import SystematicErrors, systematic_errors
from .targets import plan_targets
from .tracks_csv import Recordings


class World:
    """All targets and carriers of a scenario at any step.

    Args:
        boot: of the process that publishes the truth.

    Raises:
        ScenarioError: a recorded track cannot be had.
    """

    def __init__(self, scenario: Scenario, boot: str = "world") -> None:
        origin = origin_of(scenario.file)
        self.boot = boot
        self.declared, self._step_s = scenario.declared, scenario.file.time.step_s
        self.plans = plan_targets(scenario, origin)
        self._starts = np.array([p.start_s for p in self.plans])
        self._ends = np.array([p.end_s for p in self.plans])
        self._names, self._words = feature_names(scenario.file), word_names(scenario.file)
        features = np.array([p.features for p in self.plans], dtype=float)
        self._features = features.reshape(len(self.plans), len(self._names))
        self._paths = Paths(origin, [p.motion for p in self.plans if isinstance(p.motion, Path)])
        recorded = [p.motion for p in self.plans if not isinstance(p.motion, Path)]
        self._recordings = Recordings(origin, recorded)
        steps = self.declared.steps
        self._voyages = {
            c.name: sail(scenario.file, c, origin, steps) for c in scenario.file.carriers
        }

        errors = [_errors(scenario.file, carrier) for carrier in scenario.file.carriers]
        self._azimuth_bias_rad = _unless_none([e.azimuth_bias_rad for e in errors])
        self._range_bias_m = _unless_none([e.range_bias_m for e in errors])
        self._range_scale = _unless_none([e.range_scale for e in errors])

    def step(self, step: int) -> tuple[TruthTargets, TruthCarriers]:
        """The truth of one step, 0 .. steps; whichever were asked for before."""
        return self._targets(step), self._carriers(step)

    def t_ns(self, step: int) -> int:
        """True time of a step."""
        return self.declared.epoch_ns + step * self.declared.step_ns

    def _targets(self, step: int) -> TruthTargets:
        t_s = step * self._step_s
        on_paths, _ = self._paths.at(t_s - self._starts[: len(self._paths)])
        recorded, reported = self._recordings.at(t_s)
        everything = Kinematics(*map(np.concatenate, zip(on_paths, recorded, strict=True)))
        exists = (self._starts <= t_s) & (t_s <= self._ends)
        exists[len(self._paths) :] &= reported
        rows = np.flatnonzero(exists)
        there = [self.plans[row] for row in rows]
        position, velocity, acceleration = (values.tolist() for values in everything.take(rows))
        return TruthTargets(
            boot=self.boot,
            seq=step,
            step=step,
            t_ns=self.t_ns(step),
            number=[p.number for p in there],
            position_m=position,
            velocity_mps=velocity,
            acceleration_mps2=acceleration,
            classes=[p.class_name for p in there],
            identity=[p.identity for p in there],
            features={n: self._features[rows, i].tolist() for i, n in enumerate(self._names)},
            words={n: [p.words[i] for p in there] for i, n in enumerate(self._words)},
        )

    def _carriers(self, step: int) -> TruthCarriers:
        voyages = self._voyages.values()
        return TruthCarriers(
            boot=self.boot,
            seq=step,
            step=step,
            t_ns=self.t_ns(step),
            carrier=list(self._voyages),
            position_m=[v.truth.position_m[step].tolist() for v in voyages],
            velocity_mps=[v.truth.velocity_mps[step].tolist() for v in voyages],
            acceleration_mps2=[v.truth.acceleration_mps2[step].tolist() for v in voyages],
            heading_rad=[float(v.heading_rad[step]) for v in voyages],
            north_error_rad=[float(v.north_error_rad[step]) for v in voyages],
            clock_offset_s=[float(v.clock_offset_s[step]) for v in voyages],
            azimuth_bias_rad=self._azimuth_bias_rad,
            range_bias_m=self._range_bias_m,
            range_scale=self._range_scale,
        )


def _errors(file: ScenarioFile, carrier: Carrier) -> SystematicErrors:
    """Of its first sensor; none of a carrier that has no sensor."""
    if not carrier.sensors:
        return SystematicErrors(0.0, 0.0, 0.0, 0.0)
    return systematic_errors(file, carrier.name, carrier.sensors[0])


def _unless_none(values: list[float]) -> list[float]:
    """A column, empty where nobody errs."""
    return values if any(values) else []
