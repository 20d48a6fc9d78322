"""The best alignment of all data so far: constants and path together, most probable of all."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import chdtrc, expit

from estimation.arrays import Array
from estimation.bordered import Solution, block_covariances, descend, last_covariance, minimise
from estimation.system_alignment.bends import spread
from estimation.system_alignment.least_squares import least_squares
from estimation.system_alignment.logs import DeadReckoning, Ranges
from estimation.system_alignment.losses import ROBUST, Loss
from estimation.system_alignment.model import Model
from estimation.system_alignment.modes import Mode, doubtful, mixture
from estimation.system_alignment.observability import Direction, diagnosis
from estimation.system_alignment.parameters import Prior, offsets_of, places_of

Status = Literal["solved", "ambiguous", "not converged", "no ranges"]

_MIRROR_IN_DOUBT = 9.0  # chi2 by which the mirrored height must fit worse
_SHORT, _FEW = 25, 2  # epochs to begin with; steps before more come in
_PATIENT = 20
_SOFT = (30.0, 5.0)  # times the ranges' sigma
_TELLS = 0.05  # share of the prior's variance that data must take before they can contradict it


class PriorTest(NamedTuple):
    """Do data and prior agree?

    Attributes:
        chi2: of the estimate's distance from the prior, by what the data moved it.
        dof: directions in which the data say something.
        probability: of a chi2 as large; below .001 the prior or its sigmas are wrong.
        sigmas: (7 + 4 J,) the same distance, each constant by itself; 0 for known ones.
    """

    chi2: float
    dof: int
    probability: float
    sigmas: Array


class Alignment(NamedTuple):
    """Constants and path of one object among its beacons.

    Attributes:
        theta: (7 + 4 J,) in the order of `parameters`.
        covariance: (7 + 4 J, 7 + 4 J); zeros where a constant is known. Where the data leave an
            arc, it is the mean square along it; other modes, and the other side of a level path,
            are in it at their distance by their probability.
        path_m: (n, 2) places of the object, valid at the epochs.
        heading_error_rad: (n,) of the walk; zeros where headings are measured anew.
        cost: what was minimised, at the minimum.
        weights: (m,) of the ranges, 1 for full use, 0 for none.
        status: solved, not converged, no ranges; ambiguous where other places share the probability
            or lie along ridges that bend each other: the covariance holds them all, and is wide.
        mirror_gap: (J,) by how much chi2 grows when the beacon is put as far below as it is above;
            infinite where the height is known.
        prior_test: whether the data contradict the prior.
        undetermined: the combinations the data leave as the prior had them, named.
        others: modes that share the probability, where there may be several: looked for where no
            start was given and the prior leaves a beacon's side open, or where one solution did
            not settle or fits badly.
        solution: the factored normal equations, for every covariance of the path.
        prior: before the data.
    """

    theta: Array
    covariance: Array
    path_m: Array
    heading_error_rad: Array
    cost: float
    weights: Array
    status: Status
    mirror_gap: Array
    prior_test: PriorTest
    undetermined: tuple[Direction, ...]
    others: tuple[Mode, ...]
    solution: Solution
    prior: Prior

    @property
    def beacons_m(self) -> Array:
        """(J, 3)."""
        return self.theta[places_of(self.theta)]

    @property
    def offsets_m(self) -> Array:
        """(J,)."""
        return self.theta[offsets_of(self.theta)]

    @property
    def mirrored_in_doubt(self) -> bool:
        """Whether some beacon may as well lie on the other side of the plane of the path."""
        return bool(np.any(self.mirror_gap < _MIRROR_IN_DOUBT))

    @property
    def doubts(self) -> tuple[str, ...]:
        """Each other mode in words, with its probability; the more probable first."""
        return tuple(f"{mode.name} ({100 * mode.probability:.0f} %)" for mode in self.others)

    @property
    def end_covariance(self) -> Array:
        """(2, 2) of the last place."""
        return self.last_covariance[:2, :2]

    @property
    def last_covariance(self) -> Array:
        """(b + T, b + T) of the last place (and heading's error) and the free constants."""
        return last_covariance(self.solution, self._of_free)

    @property
    def _of_free(self) -> Array:
        """(T, T) of the free constants."""
        return self.covariance[np.ix_(self.prior.free, self.prior.free)]

    @property
    def path_covariances(self) -> Array:
        """(n, 2, 2) of every place; a Python loop over the epochs."""
        return block_covariances(self.solution, self._of_free)[:, :2, :2]


def align(
    path: DeadReckoning,
    logs: Ranges,
    prior: Prior,
    method: Literal["map", "ls"] = "map",
    start: Array | None = None,
    losses: tuple[Loss, ...] = ROBUST,
    starts: int = 24,
) -> Alignment:
    """Constants and path from dead reckoning and ranges or range differences.

    Args:
        path: n epochs.
        logs: m ranges.
        prior: of the constants; a known constant has no variance.
        method: "map", the most probable constants and path; "ls", the paper's least squares of
            the constants alone, dead reckoning taken as exact: a baseline, without prior.
        start: (7 + 4 J,) constants to start from, e.g. the online filter's; default: the prior's,
            then those of the first epochs, of twice as many, and so on.
        losses: gone through in turn, each from where the last one ended.
        starts: from how many more places other modes are looked for where there may be some.

    Raises:
        ValueError: a range of an epoch or a beacon that is not there.
    """
    _check(path, logs, prior)
    at = prior.mean if start is None else np.asarray(start, dtype=float)
    if method == "ls":
        model = Model(path, logs, prior)
        found = least_squares(model, at[prior.free])
        nothing = np.zeros((len(found.theta),) * 2)
        return _told(model, _Sides(found, np.zeros(prior.beacons), nothing), found.covariance)
    model = Model(path, logs, prior, losses[0])
    free = at[prior.free]
    x, free = (_approached if start is None else _softened)(model, free)
    last = replace(model, loss=losses[-1])
    sides = _mirrors(last, _through(losses, model, x, free))
    searching = start is None and starts > 0
    if not (searching and doubtful(last, sides.found)):
        about = spread(last, sides.found)
        if not (searching and about.far):
            return _told(last, sides, about.square + sides.doubt)
    solve, draw = partial(_through, losses, model), partial(_approached, model)
    mixed = mixture(last, sides.found, solve, draw, starts)
    sides = _mirrors(last, mixed.best)._replace(found=mixed.best)
    told = _told(last, sides, mixed.square)._replace(others=mixed.others)
    return told._replace(status="ambiguous") if mixed.ambiguous else told


def _approached(model: Model, free: Array) -> tuple[Array, Array]:
    """A start near the minimum: the first epochs alone, then twice as many, and so on.

    A wind unknown by 1 m/s puts a path of ten minutes 600 m aside, from where some alignments
    find a wrong minimum; a path half as long as the one before it never errs by so much.
    """
    n, x = len(model.path.interval_s), np.empty((0, model.block))
    count = n / 2 ** max(int(np.log2(max(n / _SHORT, 1))), 0)
    while count < n:
        path, logs = model.path.until(int(count)), model.logs.until(int(count))
        part = replace(model, path=path, logs=logs)
        found = descend(part, part.dead_reckoned(free, x), free, most=_FEW)
        x, free, count = found.x, found.theta, 2 * count
    return model.dead_reckoned(free, x), free


def _softened(model: Model, free: Array) -> tuple[Array, Array]:
    """A start nearer the minimum than the one given: with ranges believed less than they deserve.

    Constants within some hundred metres put the path as far aside; exact ranges would bend it
    along every wrong valley first.
    """
    x = model.dead_reckoned(free)
    for factor in _SOFT:
        logs = model.logs._replace(sigma_m=factor * model.logs.sigma_m)
        found = descend(replace(model, logs=logs), x, free, most=_PATIENT)
        x, free = found.x, found.theta
    return x, free


def _through(losses: tuple[Loss, ...], model: Model, x: Array, free: Array) -> Solution:
    """The minimum of the last loss, reached through the others as far as they are needed."""
    last = replace(model, loss=losses[-1])
    for loss in losses[:-1]:
        model = replace(model, loss=loss)
        found = minimise(model, x, free)
        x, free = found.x, found.theta
        residuals = last.residuals(x, free)
        weights = last.loss(residuals)[1]
        if found.converged and np.array_equal(weights, model.loss(residuals)[1]):
            return found
        if np.all(weights == 1):
            break
    return minimise(last, x, free)


def _told(model: Model, sides: _Sides, square: Array) -> Alignment:
    """The result with its checks, its free constants of a mean square error (T, T)."""
    found = sides.found
    prior, free = model.prior, model.prior.free
    covariance = np.zeros_like(prior.covariance)
    covariance[np.ix_(free, free)] = found.covariance
    believed = covariance.copy()
    believed[np.ix_(free, free)] = square
    theta = model.theta(found.theta)
    heading = found.x[:, 2] if model.block == 3 else np.zeros(len(found.x))
    return Alignment(
        theta=theta,
        covariance=believed,
        path_m=found.x[:, :2],
        heading_error_rad=heading,
        cost=found.cost,
        weights=model.loss(model.residuals(found.x, found.theta))[1],
        status=_status(model, found),
        mirror_gap=sides.gap,
        prior_test=contradiction(prior, theta, covariance),
        undetermined=diagnosis(model, found.theta, found.factored.information).undetermined,
        others=(),
        solution=found,
        prior=prior,
    )


def _status(model: Model, found: Solution) -> Status:
    if len(model.logs.value_m) == 0:
        return "no ranges"
    return "solved" if found.converged else "not converged"


class _Sides(NamedTuple):
    """Both sides of every beacon.

    Attributes:
        found: the solution with every beacon on its more probable side.
        gap: (J,) what the other side costs.
        doubt: (T, T) what it adds to the covariance of the free constants.
    """

    found: Solution
    gap: Array
    doubt: Array


def _mirrors(model: Model, found: Solution) -> _Sides:
    """The solution and its mirrors.

    Over a level path both sides fit alike and only the prior can tell; elsewhere a mirrored
    beacon that comes near is solved for anew.
    """
    height = model.path.height_m[model.logs.epoch].mean() if len(model.logs.epoch) else 0.0
    beacons = model.prior.beacons
    gap = np.full(beacons, np.inf)
    doubt = np.zeros((len(found.theta), len(found.theta)))
    for beacon, index in enumerate(places_of(model.prior.mean)[:, 2]):
        place = np.flatnonzero(model.free == index)
        if place.size == 0:
            continue
        other = found.theta.copy()
        other[place] = 2 * height - other[place]
        cost = model(found.x, other).cost
        if cost < found.cost + _MIRROR_IN_DOUBT:
            again = minimise(model, found.x, other)
            if again.converged and again.cost < found.cost:
                found, again = again, found
            cost, other = again.cost, again.theta
        gap[beacon] = cost - found.cost
        apart = other - found.theta
        doubt += expit(-gap[beacon] / 2) * np.outer(apart, apart)
    return _Sides(found, gap, doubt)


def contradiction(prior: Prior, theta: Array, covariance: Array) -> PriorTest:
    """Test an estimate against its own prior: theta - mean has the covariance P0 - P."""
    free = prior.free
    before = prior.covariance[np.ix_(free, free)]
    gained = before - covariance[np.ix_(free, free)]
    sigma = np.sqrt(np.diag(before))
    moved = theta[free] - prior.mean[free]
    root = np.linalg.cholesky(before / np.outer(sigma, sigma))
    whitener = np.linalg.inv(root) / sigma
    shares, axes = np.linalg.eigh(whitener @ gained @ whitener.T)
    told = shares > _TELLS
    chi2 = float(np.sum((axes.T @ whitener @ moved)[told] ** 2 / shares[told]))
    dof = int(told.sum())
    each = np.zeros_like(theta)
    shrunk = np.diag(gained)
    each[free] = np.where(
        shrunk > _TELLS * sigma**2, moved / np.sqrt(np.maximum(shrunk, 1e-300)), 0.0
    )
    probability = float(chdtrc(dof, chi2)) if dof else 1.0
    return PriorTest(chi2, dof, probability, each)


def _check(path: DeadReckoning, logs: Ranges, prior: Prior) -> None:
    n, beacons = len(path.interval_s), prior.beacons
    if np.any((logs.epoch < 0) | (logs.epoch >= n)):
        raise ValueError(
            f"need ranges of epochs 0 to {n - 1}: got {logs.epoch.min()} to {logs.epoch.max()}"
        )
    if np.any((logs.beacon < 0) | (logs.beacon >= beacons) | (logs.reference >= beacons)):
        raise ValueError(f"need ranges to beacons 0 to {beacons - 1}")
