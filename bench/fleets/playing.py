"""One fleet as it is played, and what came of it by the truth."""

from __future__ import annotations

import time
from collections.abc import Callable, Container
from typing import Any, NamedTuple

import numpy as np

from bench.fleets.bound import Bound, bound
from bench.fleets.families import OWN, absences
from bench.in_process import played
from crossfix.evaluation import FrameError, PictureSummary, frame_errors
from crossfix.evaluation.pictures import picture_errors, summarise_picture
from schemas.messages import Correction, Navigation, Tracks
from sim_world.scenario import Scenario, with_overrides

FRESH_S = 30.0
"""After a correction was applied for the first time."""
DIMENSIONS = 3
"""Of a frame."""


class Outcome(NamedTuple):
    """A fleet as it was played.

    Attributes:
        frames: errors of each other carrier while its correction was applied, those that were.
        others: how many other carriers there are.
        cpu_s: of all, a step.
    """

    frames: list[list[FrameError]]
    others: int
    picture: PictureSummary | None
    cpu_s: float

    def late(self) -> list[float]:
        """NEES/dim of each frame, mean over the second half of its corrections."""
        return [_nees(errors[len(errors) // 2 :]) for errors in self.frames]

    def fresh(self) -> list[float]:
        """The same over the first half minute."""
        return [
            _nees([e for e in errors if e.t_ns <= errors[0].t_ns + FRESH_S * 1e9])
            for errors in self.frames
        ]


class Pair(NamedTuple):
    """A fleet with its errors, the same with none, and what is the least that both can err."""

    family: str
    erring: Outcome
    exact: Outcome
    bound: Bound

    @property
    def ratio(self) -> float:
        """GOSPA by that without errors; nan where there is no picture."""
        erring, exact = self.erring.picture, self.exact.picture
        return erring.gospa_m / exact.gospa_m if erring and exact and exact.gospa_m else np.nan

    @property
    def allowed(self) -> float:
        """The same where what tracks err grows as the bound does."""
        exact, bound = self.exact.picture, self.bound
        if not exact or not exact.gospa_m:
            return np.nan
        squared = (exact.localisation_m * bound.error_m / bound.known_m) ** 2
        squared += exact.missed_m**2 + exact.false_m**2
        return float(np.sqrt(squared / _squared(exact)))

    @property
    def claimed(self) -> float:
        """Sigma of tracks by the least possible; nan where there are none."""
        erring = self.erring.picture
        return erring.sigma_m / self.bound.error_m if erring else np.nan

    @property
    def track_nees(self) -> float:
        """NEES/dim of tracks; nan where there are none."""
        return self.erring.picture.nees_per_dimension if self.erring.picture else np.nan


def both(family: str, scenario: Scenario) -> Pair:
    """Play a fleet of a family with its errors and with none."""
    away = absences(family, scenario.declared.steps)
    exact = with_overrides(scenario, {"errors.enabled": False})
    return Pair(family, judged(scenario, away), judged(exact, away), bound(scenario))


def judged(scenario: Scenario, away: Callable[[int], Container[str]]) -> Outcome:
    """Play a fleet and compare it with the truth."""
    known: list[Any] = []
    said: list[Any] = []
    began_s = time.process_time()
    for now in played(scenario, away=away):
        own = [m for m in now.said if isinstance(m, Navigation) and m.carrier == OWN]
        outputs = [out.message for out in now.outputs]
        known += [now.targets, now.carriers, *own, *(m for m in outputs if isinstance(m, Tracks))]
        said += [now.carriers, *(m for m in outputs if isinstance(m, Correction))]
    cpu_s = (time.process_time() - began_s) / scenario.declared.steps
    frames = frame_errors(scenario.declared, OWN, said).values()
    applied = [[error for error in errors if error.state == "applied"] for errors in frames]
    picture = summarise_picture(picture_errors(scenario.declared, OWN, known))
    others = len(scenario.declared.carriers) - 1
    return Outcome([errors for errors in applied if errors], others, picture, cpu_s)


def _nees(errors: list[FrameError]) -> float:
    return float(np.mean([error.nees for error in errors])) / DIMENSIONS


def _squared(picture: PictureSummary) -> float:
    return picture.localisation_m**2 + picture.missed_m**2 + picture.false_m**2
