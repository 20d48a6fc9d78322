"""The alignment as it grows: an extended Kalman filter of place and constants, epoch by epoch.

The state is (place east, north[, heading error]; the free constants). It works from the first
range; `align` smooths the same data about every second and is what should be published.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices
from estimation.bordered import last_covariance
from estimation.system_alignment.logs import DeadReckoning, Ranges
from estimation.system_alignment.losses import Loss, huber
from estimation.system_alignment.model import predicted_ranges
from estimation.system_alignment.parameters import HEADING_BIAS, SPEED_SCALE, WIND, Prior, places_of
from estimation.system_alignment.smoother import Alignment, align

_ASIDE = np.array([1.0, -1.0])  # a quarter turn clockwise, of (north, east)
_ANEW, _LATER = 8, 1.5  # epochs; times as many before the next time
_SEARCHED = 3  # every so many times, other modes are looked for
_BENT, _SLIGHT = 1.5, 0.1  # sigmas of a range: with what it bends; doubt of a place by the distance
_HOPELESS = 8.0  # sigmas of the prediction: a range so far off is not used at all


class Filtered(NamedTuple):
    """What the filter knows.

    Attributes:
        place: (b,) east, north [m] and, where it walks, the heading's error [rad].
        theta: (7 + 4 J,) constants.
        covariance: (b + T, b + T) of the place and the free constants.
        time_s: of validity, since the start.
        free: indices of the constants that are estimated.
        doubt: (T, T) mean square distance of other modes and of ridges, found when all data were
            last aligned anew; zeros where there are none. No part of the covariance.
    """

    place: Array
    theta: Array
    covariance: Array
    time_s: float
    free: Indices
    doubt: Array

    @property
    def theta_covariance(self) -> Array:
        """(7 + 4 J, 7 + 4 J) of all constants, doubt included; zeros where one is known."""
        b, count = len(self.place), len(self.theta)
        whole = np.zeros((count, count))
        whole[np.ix_(self.free, self.free)] = self.covariance[b:, b:] + self.doubt
        return whole

    @property
    def ambiguous(self) -> bool:
        """Whether other modes or ridges leave a doubt that no step of the filter settles."""
        return bool(self.doubt.any())


def started(path: DeadReckoning, prior: Prior) -> Filtered:
    """The filter at the known start."""
    b = 3 if path.turns else 2
    free = prior.free
    place = np.zeros(b)
    place[:2] = path.start_m
    covariance = np.zeros((b + len(free), b + len(free)))
    covariance[b:, b:] = prior.covariance[np.ix_(free, free)]
    doubt = np.zeros((len(free), len(free)))
    return Filtered(place, prior.mean.copy(), covariance, 0.0, free, doubt)


def resumed(found: Alignment, time_s: float) -> Filtered:
    """The filter where the smoother ended; the constants are free that were free there."""
    place = found.solution.x[-1].copy()
    free = found.prior.free
    doubt = np.zeros((len(free), len(free)))
    return Filtered(place, found.theta, found.last_covariance, time_s, free, doubt)


def predicted(state: Filtered, path: DeadReckoning, epoch: int) -> Filtered:
    """The filter after a step of the dead reckoning, eqs 1 and 8."""
    interval, theta, b = float(path.interval_s[epoch]), state.theta, len(state.place)
    angle = theta[HEADING_BIAS] + (state.place[2] if b == 3 else 0.0)
    sin, cos = np.sin(angle), np.cos(angle)
    east, north = (1 + theta[SPEED_SCALE]) * path.travel_m[epoch]
    travel = np.array([cos * east + sin * north, cos * north - sin * east])
    aside = travel[::-1] * _ASIDE
    whole = np.zeros((2, b + len(theta)))
    whole[0, 0] = whole[1, 1] = 1
    whole[0, b] = whole[1, b + 1] = interval
    whole[:, b + SPEED_SCALE] = travel / (1 + theta[SPEED_SCALE])
    whole[:, b + HEADING_BIAS] = aside
    if b == 3:
        whole[:, 2] = aside
    moving = np.concatenate([whole[:, :b], whole[:, b + state.free]], axis=1)
    covariance = state.covariance.copy()
    if b == 3:
        covariance[2, 2] += path.sigma_turn_rad[epoch] ** 2
    tied = moving @ covariance
    covariance[:2], covariance[:, :2] = tied, tied.T
    covariance[:2, :2] = tied @ moving.T + path.covariance[epoch]
    place = state.place.copy()
    place[:2] += travel + interval * theta[WIND]
    return state._replace(place=place, covariance=covariance, time_s=state.time_s + interval)


def updated(state: Filtered, logs: Ranges, height_m: float = 0.0, loss: Loss = huber) -> Filtered:
    """The filter after the ranges of one epoch.

    A range is believed less the further it lies from its prediction, by the loss's weight of its
    distance in sigmas of the prediction, and not at all beyond 8 sigma.
    """
    b, free = len(state.place), state.free
    count = len(logs.value_m)
    places = np.empty((count, 3))
    places[:, :2], places[:, 2] = state.place[:2], height_m
    time_s = np.full(count, state.time_s)
    value, by_place, by_theta = predicted_ranges(state.theta, logs, places, time_s)
    by_state = np.zeros((count, len(state.covariance)))
    by_state[:, :2], by_state[:, b:] = by_place, by_theta[:, free]
    gained = state.covariance @ by_state.T
    innovation = logs.value_m - value
    spread = by_state @ gained
    variance = logs.sigma_m**2
    distance = innovation / np.sqrt(np.diag(spread) + variance)
    weight = np.where(np.abs(distance) < _HOPELESS, loss(distance)[1], 1e-9)
    spread[np.diag_indices(count)] += variance / weight
    gain = np.linalg.solve(spread, gained.T).T
    step = gain @ innovation
    covariance = state.covariance - gain @ gained.T
    theta = state.theta.copy()
    theta[free] += step[b:]
    return state._replace(
        place=state.place + step[:b], theta=theta, covariance=(covariance + covariance.T) / 2
    )


def second_order(state: Filtered, logs: Ranges, height_m: float = 0.0) -> Ranges:
    """Ranges as `updated` should take them where the doubt of a place bends them.

    With the Hessian H = (I - u u') / r of a range and the covariance C of object less beacon, a
    range is on average tr(H C) / 2 longer than between the means, with a variance of its own of
    tr(H C H C) / 2. Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking
    and Navigation, 10.3.2. Nothing changes where places are known well against their distance.
    """
    longer, variance = _bend(state, logs.beacon, height_m)
    differs = np.flatnonzero(logs.reference >= 0)
    if differs.size:
        less, more = _bend(state, logs.reference[differs], height_m)
        longer[differs] -= less
        variance[differs] += more
    sigma = np.sqrt(logs.sigma_m**2 + variance)
    return logs._replace(value_m=logs.value_m - longer, sigma_m=sigma)


def _bend(state: Filtered, beacon: Indices, height_m: float) -> tuple[Array, Array]:
    """Mean and variance (m,) of the second-order term of the ranges to beacons (m,)."""
    b, where = len(state.place), places_of(state.theta)[beacon]
    whole = np.zeros((b + len(state.theta),) * 2)
    at = np.concatenate([np.arange(b), b + state.free])
    whole[np.ix_(at, at)] = state.covariance
    by_place = np.zeros((3, len(whole)))
    by_place[0, 0] = by_place[1, 1] = 1
    apart = np.tile(by_place, (len(beacon), 1, 1))
    np.put_along_axis(apart, b + where[:, :, None], -1.0, axis=2)
    covariance = apart @ whole @ apart.transpose(0, 2, 1)
    sight = np.array([*state.place[:2], height_m]) - state.theta[where]
    length = np.maximum(np.linalg.norm(sight, axis=1), 1.0)[:, None, None]
    unit = sight[:, :, None] / length
    bent = (np.eye(3) - unit @ unit.transpose(0, 2, 1)) @ covariance / length
    longer: Array = np.trace(bent, axis1=1, axis2=2) / 2
    variance: Array = np.trace(bent @ bent, axis1=1, axis2=2) / 2
    return longer, variance


def filtered(path: DeadReckoning, logs: Ranges, prior: Prior) -> Iterator[Filtered]:
    """The filter after every epoch of a path.

    Once the doubt of a place has bent ranges by more than their noise, no filter remembers what
    they have said: from then on all so far are aligned anew at epochs 8, 12, 18 and so on. Other
    modes are looked for at every third of these times only, for that can take seconds; the doubt
    they leave is carried on until the next.
    """
    order = np.argsort(logs.epoch, kind="stable")
    logs = logs.of(order)
    ends = np.searchsorted(logs.epoch, np.arange(len(path.interval_s) + 1))
    state, bent, anew, count = started(path, prior), False, _ANEW, 0
    for epoch, (first, last) in enumerate(pairwise(ends)):
        state = predicted(state, path, epoch)
        if last > first:
            now, height = logs.of(slice(first, last)), float(path.height_m[epoch])
            taken = second_order(state, now, height) if _may_bend(state, now, height) else now
            bent = bent or bool(np.any(taken.sigma_m > _BENT * now.sigma_m))
            state = updated(state, taken, height)
        if bent and epoch + 1 >= anew:
            so_far = path.until(epoch + 1), logs.of(slice(0, last)), prior
            state = _searched(state, *so_far) if count % _SEARCHED == 0 else _anew(state, *so_far)
            anew, count = int(_LATER * anew), count + 1
        yield state


def _anew(state: Filtered, path: DeadReckoning, logs: Ranges, prior: Prior) -> Filtered:
    """The state of all data aligned anew, the doubt as it was."""
    return resumed(align(path, logs, prior, starts=0), state.time_s)._replace(doubt=state.doubt)


def _searched(state: Filtered, path: DeadReckoning, logs: Ranges, prior: Prior) -> Filtered:
    """The same with other modes looked for."""
    found = align(path, logs, prior)
    if found.status != "ambiguous":
        return resumed(found, state.time_s)
    of_free = found.covariance[np.ix_(prior.free, prior.free)]
    sure = found.solution.covariance
    alone = last_covariance(found.solution, sure)
    return resumed(found, state.time_s)._replace(covariance=alone, doubt=of_free - sure)


def _may_bend(state: Filtered, logs: Ranges, height_m: float) -> bool:
    """Whether the second order of some range may be a tenth of its noise: a quick bound."""
    b, where = len(state.place), places_of(state.theta)
    variance = np.zeros(len(state.theta))
    variance[state.free] = np.diag(state.covariance)[b:]
    apart = state.theta[where] - np.array([*state.place[:2], height_m])
    doubt = variance[where].max(axis=1) + state.covariance[[0, 1], [0, 1]].max()
    bend = doubt / np.maximum(np.sqrt(np.sum(apart**2, axis=1)), 1.0)
    return bool(np.any(bend[logs.beacon] > _SLIGHT * logs.sigma_m)) or bool(
        np.any((bend[logs.reference] > _SLIGHT * logs.sigma_m) & (logs.reference >= 0))
    )
