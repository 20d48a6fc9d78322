"""Range biases, a range scale and a clock offset beside the frame, as optional states.

Each has a prior sigma; zero leaves it out. Corrections are *added*, as everywhere: true range =
(reported + bias) (1 + scale), the other's targets are seen `clock` seconds later than stamped.
Only the scale of the other's ranges *against the own ones* is a state: a scale common to both
carriers stretches targets and baseline alike and changes no misclosure, whatever the geometry.
A clock offset moves every target of the other by its velocity: without velocities, or with the
same velocity for all (a convoy), nothing tells it from a shift of place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, transposed
from estimation.frames import wrap_pi
from estimation.relative_frame.adjustment import batch_of, rigid_fit
from estimation.relative_frame.gauge import Gauge, gauge
from estimation.relative_frame.gauss_helmert import measured
from estimation.relative_frame.iteration import iterate
from estimation.relative_frame.logs import OwnAxesFrame, PolarLogs, RelativeFramePrior
from estimation.relative_frame.matrices import Indices

NAMES = (
    "location east",
    "location north",
    "orientation",
    "own range bias",
    "other range bias",
    "range scale of the other against own",
    "clock offset of the other",
)


class SensorErrorPrior(NamedTuple):
    """Prior sigmas; zero: known to be right, no state.

    Attributes:
        own_bias_m, other_bias_m: of the ranges of each carrier.
        scale: of the other's ranges against the own ones (1e-3 = 1 m in a kilometre).
        clock_s: of the other's clock against the own one.
    """

    own_bias_m: float = 0.0
    other_bias_m: float = 0.0
    scale: float = 0.0
    clock_s: float = 0.0


class SensorRegistration(NamedTuple):
    """A frame and sensor errors; K = 7 in the order of `NAMES`.

    Attributes:
        own_axes: (q, D), its covariance with the sensor errors taken into account.
        errors: (..., 4) own bias, other bias [m], scale, clock offset [s].
        covariance: (..., 7, 7) of all.
        information: (..., 7, 7) of the targets alone.
        prior_covariance: (..., 7, 7) of the prior alone, at the estimate.
        chi2: (...) chi-squared of 2 L.
        converged: (...) False: not to be used.
    """

    own_axes: OwnAxesFrame
    errors: Array
    covariance: Array
    information: Array
    prior_covariance: Array
    chi2: Array
    converged: NDArray[np.bool_]


class _Extended(NamedTuple):
    """Navigation's prior, and independent sigmas (4,) of the sensor errors (`gauge.Prior`)."""

    frame: Gauge
    sigmas: Array

    def at(self, z: Array) -> tuple[Array, Array]:
        """Frame and sensor errors (N, 7) of z (N, 8), and their derivative."""
        point, tangent = self.frame.at(z[:, :4])
        whole = np.zeros((len(z), 7, 8))
        whole[:, :3, :4] = tangent
        whole[:, range(3, 7), range(4, 8)] = self.sigmas
        return np.concatenate([point, self.sigmas * z[:, 4:]], axis=1), whole

    def moved(self, z: Array, step: Array, aim: Array) -> Array:
        """The frame as the gauge moves it; sensor errors are linear."""
        frame = self.frame.moved(z[:, :4], step[:, :4], aim)
        return np.concatenate([frame, z[:, 4:] + step[:, 4:]], axis=1)

    def bend(self, z: Array) -> Array:
        """That of the gauge."""
        whole = np.zeros((len(z), 8, 8))
        whole[:, :4, :4] = self.frame.bend(z[:, :4])
        return whole

    def of(self, which: Indices) -> _Extended:
        """The experiments `which`."""
        return _Extended(self.frame.of(which), self.sigmas)


def adjustment_with_sensor_errors(
    own: PolarLogs,
    other: PolarLogs,
    prior: RelativeFramePrior,
    sensors: SensorErrorPrior,
    velocity_mps: Array | None = None,
) -> SensorRegistration:
    """`adjustment` with range biases, a relative range scale and a clock offset as states.

    Args:
        own: (..., L) logs in own axes.
        other: (..., L) logs of the same targets in the other carrier's axes.
        prior: reported offset and the sigmas of it and of both norths.
        sensors: prior sigmas of the sensor errors.
        velocity_mps: (..., L, 2) of the targets, east and north of the *other's* axes; without
            them a clock offset keeps its prior.

    Raises:
        ValueError: own and other differ in length.
    """
    batch = batch_of(own, other, prior)
    given, navigation = measured(own, other, batch), gauge(prior, batch)
    if velocity_mps is not None:
        shape = (*batch, own.count, 2)
        flat = np.broadcast_to(velocity_mps, shape).reshape(-1, own.count, 2)
        given = given._replace(velocity_mps=flat)
    extended = _Extended(navigation, np.array(sensors, dtype=float))
    start = rigid_fit(given, navigation)
    end = iterate(given, extended, np.concatenate([start, np.zeros_like(start)], axis=1))
    point, tangent = extended.at(end.z)
    covariance = tangent @ end.covariance @ transposed(tangent)
    return SensorRegistration(
        OwnAxesFrame(
            point[:, :2].reshape(*batch, 2),
            wrap_pi(point[:, 2]).reshape(batch),
            covariance[:, :3, :3].reshape(*batch, 3, 3),
        ),
        point[:, 3:].reshape(*batch, 4),
        covariance.reshape(*batch, 7, 7),
        end.information.reshape(*batch, 7, 7),
        (tangent @ transposed(tangent)).reshape(*batch, 7, 7),
        end.criterion.reshape(batch),
        end.converged.reshape(batch),
    )
