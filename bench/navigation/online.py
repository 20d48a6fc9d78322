"""The online filter of the joint state beside the solution over the whole history."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, between, told
from bench.navigation.together import Truth, scene
from estimation.arrays import Array
from estimation.consistency import nees
from estimation.joint_navigation import HEADING as HEADING_CONSTANT
from estimation.joint_navigation import LOG_TIME as LOG_TIME_CONSTANT
from estimation.joint_navigation import Group, constant, solve
from estimation.joint_navigation.filtered import carrier_block, filtered, pivot_of, source_block
from estimation.joint_navigation.online import HEADING, LOG_TIME, Joint


class Ends(NamedTuple):
    """Places, headings but the own one, and log times at the last epoch; their covariance."""

    value: Array
    covariance: Array


def online(group: Group) -> Ends:
    """By the filter."""
    *_, last = filtered(group)
    return ends(last, group)


def ends(joint: Joint, group: Group) -> Ends:
    """Of one joint state."""
    first = [joint.first(carrier_block(c)) for c in range(group.carriers)]
    slots = [at + axis for at in first for axis in (0, 1)] + [at + HEADING for at in first[1:]]
    slots += [joint.first(source_block(c)) + LOG_TIME for c in range(group.carriers)]
    value = joint.mean[slots]
    value[: 2 * group.carriers] += np.tile(pivot_of(group)[:2], group.carriers)
    return Ends(value, joint.of(slots))


def solved(group: Group) -> Ends:
    """By the solution over all epochs; covariances between places and constants are left out."""
    found, count = solve(group), group.carriers
    which = [constant(c, HEADING_CONSTANT) for c in range(1, count)]
    which += [constant(c, LOG_TIME_CONSTANT) for c in range(count)]
    variances = [np.diag(found.end_covariance), np.diag(found.covariance)[which]]
    value = np.concatenate([found.carriers_m[-1].ravel(), found.constants.ravel()[which]])
    return Ends(value, np.diag(np.concatenate(variances)))


def truth_of(truth: Truth) -> Array:
    """What both estimate."""
    return np.concatenate([truth.places_m[-1].ravel(), truth.heading_rad[1:], truth.log_time_s])


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """How far the filter ends from the solution, and how honest it is."""
    rng = np.random.default_rng([seed, 40])
    apart, larger, normalised = [], [], []
    for _ in range(max(runs // 10, 4)):
        group, truth = scene(rng)
        mine, whole = online(group), solved(group)
        sigma = np.sqrt(np.diag(whole.covariance))
        apart.append(np.abs(mine.value - whole.value) / sigma)
        larger.append(np.sqrt(np.diag(mine.covariance)) / sigma)
        error = mine.value - truth_of(truth)
        normalised.append(float(nees(error, mine.covariance)) / len(error))
    places = 2 * group.carriers
    each = np.array(apart)
    yield told("online: places from the solution's, mean", each[:, :places].mean(), "sigma")
    yield told("online: log times from the solution's, mean", each[:, -3:].mean(), "sigma")
    yield told("online: sigma by the solution's, mean", float(np.mean(larger)))
    yield between("online: NEES by dimension", float(np.mean(normalised)), 0.85, 1.25)
