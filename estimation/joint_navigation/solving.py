"""One most probable solution for a whole group: places, headings, clocks, beacons, targets."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.bordered import Solution, block_covariances, descend, last_covariance, minimise
from estimation.frames import rotation_clockwise
from estimation.joint_navigation.group import (
    CONSTANTS,
    HEADING,
    CarrierPrior,
    Group,
    Ranging,
)
from estimation.joint_navigation.rows import Factors
from estimation.system_alignment.losses import ROBUST, Loss

Status = Literal["solved", "not converged"]

_UNDETERMINED = 0.9  # posterior over prior sigma of a constant
_FIXED_M = 1e-3
_SOFT, _PATIENT = 30.0, 12


class Solved(NamedTuple):
    """A group solved.

    Attributes:
        carriers_m: (n, C, 2) places at the epochs.
        constants: (C, 8) of the carriers.
        beacons_m: (J, 3).
        targets: (n, M, 4) east, north, velocity east, north.
        covariance: (8 C + 3 J, 8 C + 3 J) of the constants; zeros where known.
        cost: at the minimum.
        status: solved or not converged.
        undetermined: constants left at .9 or more of their prior sigma, in words.
        solution: the factored normal equations.
        group: what it was made of.
    """

    carriers_m: Array
    constants: Array
    beacons_m: Array
    targets: Array
    covariance: Array
    cost: float
    status: Status
    undetermined: tuple[str, ...]
    solution: Solution
    group: Group

    @property
    def end_covariance(self) -> Array:
        """(2 C, 2 C) of all carriers' last places, together."""
        size = 2 * self.group.carriers
        return last_covariance(self.solution)[:size, :size]

    @property
    def place_covariances(self) -> Array:
        """(n, 2 C, 2 C) of all carriers' places at every epoch; a Python loop over them."""
        size = 2 * self.group.carriers
        return block_covariances(self.solution)[:, :size, :size]


def solve(group: Group, losses: tuple[Loss, ...] = ROBUST) -> Solved:
    """All factors of a group together, by the solver of the system alignment.

    Args:
        group: paths, priors and measurements.
        losses: gone through in turn.

    Raises:
        ValueError: paths and priors differ in number, or a measurement names what is not there.
    """
    _check(group)
    x, free = _start(group), group.mean[group.free]
    soft = replace(group, ranging=_softened(group.ranging))
    near = descend(Factors(soft, losses[0]), x, free, _PATIENT)
    x, free = near.x, near.theta
    for loss in losses:
        found = minimise(Factors(group, loss), x, free)
        x, free = found.x, found.theta
    return _told(group, found)


def with_north_of(group: Group, own: int) -> Group:
    """The same group with the north of one carrier as the gauge.

    A turn of everything about the only known place, or about the own carrier, changes no
    measurement: somebody's north must be right by definition.
    """
    return _with_prior(group, own, group.priors[own]._replace(heading_rad=0.0))


def anchored(group: Group, own: int) -> Group:
    """The same group with one carrier as the whole gauge: its start and its north are right."""
    prior = group.priors[own]._replace(start_m=_FIXED_M, heading_rad=0.0)
    return _with_prior(group, own, prior)


def _with_prior(group: Group, own: int, prior: CarrierPrior) -> Group:
    priors = list(group.priors)
    priors[own] = prior
    return replace(group, priors=tuple(priors))


def _softened(ranging: Ranging) -> Ranging:
    """Ranges believed less: exact ones would bend wrong paths along every wrong valley first."""
    return ranging._replace(sigma_m=_SOFT * ranging.sigma_m)


def relative(found: Solved, own: int, epoch: int = -1) -> Array:
    """(C, 2) places of all carriers from the own one, in its own axes, as it believes north."""
    apart = found.carriers_m[epoch] - found.carriers_m[epoch, own]
    turned: Array = apart @ rotation_clockwise(-found.constants[own, HEADING]).T
    return turned


def _start(group: Group) -> Array:
    """Carriers where dead reckoning has them, targets where their logs put them."""
    n, carriers = len(group.interval_s), group.carriers
    x = np.zeros((n, group.block))
    for carrier, path in enumerate(group.paths):
        x[:, 2 * carrier : 2 * carrier + 2] = path.path_m
    logs = group.logs
    level = logs.range_m[:, None] * np.column_stack(
        [np.sin(logs.bearing_rad), np.cos(logs.bearing_rad)]
    )
    own = np.stack([x[logs.epoch, 2 * logs.carrier + i] for i in range(2)], axis=1)
    for target in range(group.targets):
        mine = np.flatnonzero(logs.target == target)
        if mine.size:
            first = 2 * carriers + 4 * target
            x[:, first : first + 4] = _straight(
                group.time_s, group.time_s[logs.epoch[mine]], (own + level)[mine]
            )
    return x


def _straight(time_s: Array, at_s: Array, places_m: Array) -> Array:
    """(n, 4) uniform motion nearest to places (m, 2)."""
    middle = at_s.mean()
    design = np.column_stack([np.ones_like(at_s), at_s - middle])
    rank = 2 if np.ptp(at_s) > 0 else 1
    fitted = np.zeros((2, 2))
    fitted[:rank] = np.linalg.lstsq(design[:, :rank], places_m, rcond=None)[0]
    places = fitted[0] + (time_s - middle)[:, None] * fitted[1]
    return np.hstack([places, np.broadcast_to(fitted[1], places.shape)])


def _told(group: Group, found: Solution) -> Solved:
    """The result by its parts."""
    theta = Factors(group, ROBUST[-1]).theta(found.theta)
    carriers, n = group.carriers, len(found.x)
    covariance = np.zeros((len(theta), len(theta)))
    covariance[np.ix_(group.free, group.free)] = found.covariance
    return Solved(
        carriers_m=found.x[:, : 2 * carriers].reshape(n, carriers, 2),
        constants=theta[: CONSTANTS * carriers].reshape(carriers, CONSTANTS),
        beacons_m=theta[CONSTANTS * carriers :].reshape(-1, 3),
        targets=found.x[:, 2 * carriers :].reshape(n, group.targets, 4),
        covariance=covariance,
        cost=found.cost,
        status="solved" if found.converged else "not converged",
        undetermined=tuple(_undetermined(group, covariance)),
        solution=found,
        group=group,
    )


def _undetermined(group: Group, covariance: Array) -> list[str]:
    """Names of constants of which the data say next to nothing."""
    left = np.sqrt(np.diag(covariance)[group.free]) / group.sigma[group.free]
    names = _names(group)
    return [names[i] for i in group.free[left >= _UNDETERMINED]]


def _names(group: Group) -> list[str]:
    """Of all constants; carriers and beacons counted from 1."""
    own = (
        "heading",
        "speed scale",
        "current east",
        "current north",
        "clock offset",
        "clock drift",
        "log time",
        "log drift",
    )
    carriers = [f"{what} of carrier {c + 1}" for c in range(group.carriers) for what in own]
    beacons = [f"{axis} of beacon {j + 1}" for j in range(len(group.beacons_m)) for axis in "xyz"]
    return carriers + beacons


def _check(group: Group) -> None:
    n, nodes = len(group.interval_s), group.carriers + len(group.beacons_m)
    if len(group.priors) != group.carriers:
        raise ValueError(f"need a prior of each carrier: {len(group.priors)} of {group.carriers}")
    kinds = (group.ranging, group.logs, group.azimuths, group.fixes)
    if any(np.any((kind.epoch < 0) | (kind.epoch >= n)) for kind in kinds):
        raise ValueError(f"need measurements of epochs 0 to {n - 1}")
    if any(np.any(kind.carrier >= group.carriers) for kind in kinds):
        raise ValueError(f"need carriers 0 to {group.carriers - 1}")
    if any(np.any(kind.peer >= nodes) for kind in (group.ranging, group.azimuths)):
        raise ValueError(f"need nodes 0 to {nodes - 1}: carriers, then beacons")
    if np.any(group.logs.target >= group.targets):
        raise ValueError(f"need targets 0 to {group.targets - 1}")
