"""Benchmark G: the paper's helicopter circles between two beacons, in wind it does not know."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.bordered import factor, inverse, normal_equations
from estimation.consistency import nees, rms
from estimation.system_alignment import (
    Alignment,
    DeadReckoning,
    Prior,
    Ranges,
    align,
    dead_reckoning,
    offsets_of,
    places_of,
    prior,
    ranges,
)
from estimation.system_alignment.model import Model
from estimation.system_alignment.parameters import WIND

DEG = np.pi / 180
BEACONS_M = np.array([[1000.0, 0.0, 500.0], [-4000.0, 0.0, 500.0]])
RADIUS_M, SPEED_MPS, INTERVAL_S = 3000.0, 30.0, 3.0
HALF_HEADING_RAD, HALF_SPEED_MPS, HALF_RANGE_M = 0.5 * DEG, 1.0, 6.0  # of uniform errors
SIGMA_BEACON_M, SIGMA_WIND_MPS, SIGMA_OFFSET_M = 50.0, 1.0, 10.0
ROOT3 = np.sqrt(3.0)


class Truth(NamedTuple):
    """What is to be found: beacons (2, 3), wind (2,), offsets (2,), path (n, 2)."""

    beacons_m: Array
    wind_mps: Array
    offsets_m: Array
    path_m: Array


class Flight(NamedTuple):
    """One run of the benchmark."""

    path: DeadReckoning
    logs: Ranges
    prior: Prior
    truth: Truth


def flight(
    rng: np.random.Generator,
    epochs: int,
    *,
    differences: bool = False,
    offsets: bool = False,
    fixed: bool = False,
    sigma_beacon_m: float = SIGMA_BEACON_M,
    sigma_wind_mps: float = SIGMA_WIND_MPS,
) -> Flight:
    """A flight of so many epochs.

    Args:
        differences: measure the range to the second beacon less that to the first.
        offsets: let the ranges have offsets d, which the prior admits.
        fixed: variant F, the paper's: every constant errs by one sigma upwards; else variant R.
        sigma_beacon_m: of the prior; the error stays as the benchmark has it.
    """
    beacons, wind, bias = _constants(rng, fixed=fixed)
    bias = bias * offsets * (np.array([0, 1]) if differences else 1)
    heading = -(np.arange(epochs) + 0.5) * INTERVAL_S * SPEED_MPS / RADIUS_M
    air = SPEED_MPS * np.column_stack([np.sin(heading), np.cos(heading)])
    places = np.cumsum(INTERVAL_S * (air + wind), axis=0)
    truth = Truth(beacons, wind, bias, places)
    path = dead_reckoning(
        INTERVAL_S,
        SPEED_MPS + rng.uniform(-HALF_SPEED_MPS, HALF_SPEED_MPS, epochs),
        heading + rng.uniform(-HALF_HEADING_RAD, HALF_HEADING_RAD, epochs),
        HALF_SPEED_MPS / ROOT3,
        HALF_HEADING_RAD / ROOT3,
    )
    known = prior(
        BEACONS_M,
        sigma_beacon_m,
        sigma_wind_mps=sigma_wind_mps,
        sigma_offset_m=_offset_sigmas(differences=differences) * offsets,
    )
    return Flight(path, _measured(rng, truth, differences=differences), known, truth)


def _constants(rng: np.random.Generator, *, fixed: bool) -> tuple[Array, Array, Array]:
    """Beacons, wind and offsets as they really are."""
    drawn = [np.ones(s) if fixed else rng.standard_normal(s) for s in ((2, 3), (2,), (2,))]
    return (
        BEACONS_M + SIGMA_BEACON_M * drawn[0],
        SIGMA_WIND_MPS * drawn[1],
        SIGMA_OFFSET_M * drawn[2],
    )


def _offset_sigmas(*, differences: bool) -> Array:
    return SIGMA_OFFSET_M * (np.array([0.0, 1.0]) if differences else np.ones(2))


def _measured(rng: np.random.Generator, truth: Truth, *, differences: bool) -> Ranges:
    epochs = len(truth.path_m)
    level = truth.path_m[:, None] - truth.beacons_m[:, :2]
    exact = np.sqrt(np.sum(level**2, axis=2) + truth.beacons_m[:, 2] ** 2) + truth.offsets_m
    if differences:
        values = exact[:, 1] - exact[:, 0] + rng.uniform(-HALF_RANGE_M, HALF_RANGE_M, epochs)
        return ranges(np.arange(epochs), 1, values, HALF_RANGE_M / ROOT3, reference=0)
    values = exact + rng.uniform(-HALF_RANGE_M, HALF_RANGE_M, exact.shape)
    columns = np.arange(epochs).repeat(2), np.tile([0, 1], epochs)
    return ranges(*columns, values.ravel(), HALF_RANGE_M / ROOT3)


def truth_of(flown: Flight) -> Array:
    """(7 + 4 J,) the true constants."""
    theta = flown.prior.mean.copy()
    theta[WIND] = flown.truth.wind_mps
    theta[places_of(theta)] = flown.truth.beacons_m
    theta[offsets_of(theta)] = flown.truth.offsets_m
    return theta


class Score(NamedTuple):
    """Alignments of many flights.

    Attributes:
        errors: (N, 7 + 4 J).
        variances: (N, 7 + 4 J) of the posterior bound: as any method would state them if it
            linearised at the truth.
        nees: (N,) by dimension.
        solved: (N,).
    """

    errors: Array
    variances: Array
    nees: Array
    solved: NDArray[np.bool_]

    def rmse(self, what: str) -> float:
        """Of the coordinates "xy" or "z", the wind "W" or the offsets "d"."""
        return float(rms(self.errors[:, self._columns(what)]))

    def bound(self, what: str) -> float:
        """The posterior bound of the same."""
        return float(np.sqrt(self.variances[:, self._columns(what)].mean()))

    def relative_error(self, what: str) -> float:
        """Standard error of the RMSE by the RMSE, from the scatter of the flights."""
        each = np.mean(self.errors[:, self._columns(what)] ** 2, axis=1)
        return float(each.std() / each.mean() / (2 * np.sqrt(len(each))))

    def mirrored(self) -> int:
        """Runs in which a beacon ended up below the path."""
        heights = places_of(self.errors[0])[:, 2]
        return int(np.any(self.errors[:, heights] < -BEACONS_M[0, 2], axis=1).sum())

    def _columns(self, what: str) -> list[int]:
        where, offsets = places_of(self.errors[0]), offsets_of(self.errors[0])
        seen = offsets[self.variances[0, offsets] > 0]
        columns = {"xy": where[:, :2].ravel(), "z": where[:, 2], "W": np.arange(2), "d": seen}
        return [int(i) for i in columns[what]]


def score(flights: Iterable[Flight], method: Callable[[Flight], Alignment]) -> Score:
    """Errors, stated variances and NEES of a method."""
    flights = list(flights)
    pairs = [(method(flown), flown) for flown in flights]
    errors = np.array([found.theta - truth_of(flown) for found, flown in pairs])
    free = [flown.prior.free for _, flown in pairs]
    normalised = [
        float(nees(error[i], found.covariance[np.ix_(i, i)])) / len(i)
        for error, i, (found, _) in zip(errors, free, pairs, strict=True)
    ]
    return Score(
        errors,
        np.array([bound_of(flown) for flown in flights]),
        np.array(normalised),
        np.array([found.status == "solved" for found, _ in pairs]),
    )


def bound_of(flown: Flight) -> Array:
    """(7 + 4 J,) variances of the constants when everything is linearised at the truth."""
    model, free = Model(flown.path, flown.logs, flown.prior), flown.prior.free
    normal = normal_equations(model(flown.truth.path_m, truth_of(flown)[free]))
    variances = np.zeros(len(flown.prior.mean))
    variances[free] = np.diag(inverse(factor(normal).information))
    return variances


def aligned(flown: Flight) -> Alignment:
    """The method of `estimation.system_alignment`, as shipped."""
    return align(flown.path, flown.logs, flown.prior)


def papers(flown: Flight) -> Alignment:
    """The paper's least squares."""
    return align(flown.path, flown.logs, flown.prior, method="ls")


def with_late_ranges(rng: np.random.Generator, flown: Flight, share: float) -> Flight:
    """The same flight, some ranges heard by a detour of 30 to 300 m."""
    value = flown.logs.value_m
    late = (rng.random(len(value)) < share) * rng.uniform(30, 300, len(value))
    return flown._replace(logs=flown.logs._replace(value_m=value + late))
