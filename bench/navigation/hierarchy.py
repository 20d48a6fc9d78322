"""Benchmark S: a controller, four primary users that hear it, a secondary that hears only them.

The problem is linear in the errors, so the true covariance of every method, right or wrong, follows
exactly from the gains it uses: no Monte-Carlo.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.frames import east_north_from_polar
from estimation.mutual_navigation import (
    Fix,
    Gaussian,
    Message,
    Seen,
    Wander,
    by_cosines,
    corrected,
    fused,
    joint_start,
    joint_step,
    links,
    network,
    predicted,
    predicted_fix,
    seen,
    updated,
)

DEG = np.pi / 180
PRIMARIES, SECONDARY = 4, 4
HEIGHT_M = 8000.0
USERS = 5
CONTROLLER, GROUND = 5, (6, 7)
PLACES_M = np.array(
    [
        *(
            [*east_north_from_polar(bearing * DEG, distance * 1e3), HEIGHT_M]
            for distance, bearing in (
                (30.0, 60.0),
                (35.0, 85.0),
                (30.0, 200.0),
                (25.0, 320.0),
                (14.4, 56.0),
            )
        ),
        [0.0, 0.0, HEIGHT_M],
        [*east_north_from_polar(310 * DEG, 50e3), 0.0],
        [*east_north_from_polar(110 * DEG, 60e3), 0.0],
    ]
)
SIGMA_M, INTERVAL_S, DURATION_S = 5.0, 2.0, 600.0
CONTROLLER_ERROR = (30.0, 600.0)  # per axis [m], memory [s]
WANDER = Wander()
NET = network(USERS, 1, 2)
LEVEL_AND_HEIGHT = np.array([0, 1, 4])


class Run(NamedTuple):
    """What the secondary user has at every epoch.

    Attributes:
        true_m: 2 sigma_r of its real error.
        believed_m: 2 sigma_r as it states.
        nees: expected, of its horizontal place, by dimension.
        excess: largest eigenvalue of P_believed^-1 P_true of its state.
    """

    true_m: Array
    believed_m: Array
    nees: Array
    excess: Array


Method = Callable[[], "Run"]


def rows(pairs: list[tuple[int, int]]) -> Seen:
    """Pseudoranges of the true geometry."""
    return seen(NET, PLACES_M, np.zeros(NET.size), links(pairs, SIGMA_M))


UPWARD = rows([(user, node) for user in range(PRIMARIES) for node in (CONTROLLER, *GROUND)])
DOWNWARD = rows([(SECONDARY, primary) for primary in range(PRIMARIES)])
FIRST, NOISE = joint_step([WANDER] * USERS, INTERVAL_S, [CONTROLLER_ERROR])
OWN = NET.states(SECONDARY)


def exact(improved: Array | None, *, two_way: bool = True, ideal: bool = False) -> Run:
    """Filters whose covariance is the true one.

    Args:
        improved: states that any measurement may correct; None: all, the centralised filter.
        two_way: the secondary's ranges correct the primaries as well.
        ideal: the controller knows where it is.
    """
    start = joint_start([WANDER] * USERS, [CONTROLLER_ERROR])
    noise = NOISE.copy()
    if ideal:
        start[-3:], noise[-3:] = 0, 0
    state, told = Gaussian(np.zeros(NET.size), start), []
    for _ in range(round(DURATION_S / INTERVAL_S)):
        state = predicted(state, FIRST, noise)
        state = _used(state, UPWARD, improved)
        state = _used(state, DOWNWARD, improved if two_way else OWN)
        own = state.covariance[np.ix_(OWN, OWN)]
        told.append(_told(own, own))
    return _run(told)


def _used(state: Gaussian, rows: Seen, improved: Array | None) -> Gaussian:
    which = None if improved is None else np.asarray(improved, dtype=np.intp)
    return updated(state, np.zeros(len(rows.innovation)), rows.by_state, rows.noise, which)


Gain = Callable[[Array, Seen, Array], tuple[Array, Array]]


def local(gain: Gain) -> Run:
    """Users that keep a covariance of their own alone; the truth is followed beside it."""
    truth = Gaussian(np.zeros(NET.size), joint_start([WANDER] * USERS, [CONTROLLER_ERROR]))
    believed = [WANDER.start for _ in range(USERS)]
    step, wander_noise = WANDER.step(INTERVAL_S)
    told = []
    for _ in range(round(DURATION_S / INTERVAL_S)):
        truth = predicted(truth, FIRST, NOISE)
        believed = [step @ p @ step.T + wander_noise for p in believed]
        for user in (*range(PRIMARIES), SECONDARY):
            heard = _of(UPWARD if user < PRIMARIES else DOWNWARD, user)
            own = NET.states(user)
            sent = _sent_variances(heard, user, believed)
            part = heard._replace(by_state=heard.by_state[:, own])
            k, believed[user] = gain(believed[user], part, sent)
            truth = _corrected(truth, heard, own, k)
        told.append(_told(believed[SECONDARY], truth.covariance[np.ix_(OWN, OWN)]))
    return _run(told)


def uncorrelated(believed: Array, heard: Seen, sent: Array) -> tuple[Array, Array]:
    """Every message is taken as if its errors were its own."""
    return _kalman(believed, heard, np.diag(sent) + heard.noise)


def cosines(believed: Array, heard: Seen, sent: Array) -> tuple[Array, Array]:
    """The paper's: what the senders add is correlated by the cosines of the angles between them.

    The noise of the ranges themselves stays apart: with four sources the matrix of cosines alone is
    singular, and the filter would believe itself to be exact in a direction.
    """
    return _kalman(believed, heard, by_cosines(heard.unit, sent) + heard.noise)


def _kalman(believed: Array, heard: Seen, noise: Array) -> tuple[Array, Array]:
    h = heard.by_state
    gain = np.linalg.solve(h @ believed @ h.T + noise, h @ believed).T
    after = believed - gain @ h @ believed
    return gain, (after + after.T) / 2


def split(duration_s: float = DURATION_S) -> Run:
    """Split covariance intersection, message by message."""
    truth = Gaussian(np.zeros(NET.size), joint_start([WANDER] * USERS, [CONTROLLER_ERROR]))
    blank = np.zeros((7, 7))
    fixes = [Fix(np.zeros(7), WANDER.start, blank, frozenset({f"user {i}"})) for i in range(USERS)]
    step, noise = WANDER.step(INTERVAL_S)
    told = []
    for _ in range(round(duration_s / INTERVAL_S)):
        truth = predicted(truth, FIRST, NOISE)
        fixes = [predicted_fix(fix, step, noise) for fix in fixes]
        for user in (*range(PRIMARIES), SECONDARY):
            heard = _of(UPWARD if user < PRIMARIES else DOWNWARD, user)
            for row in range(len(heard.innovation)):
                fixes[user], truth = _intersected(fixes, truth, user, _of_row(heard, row))
        told.append(_told(fixes[SECONDARY].covariance, truth.covariance[np.ix_(OWN, OWN)]))
    return _run(told)


def _intersected(fixes: list[Fix], truth: Gaussian, user: int, heard: Seen) -> tuple[Fix, Gaussian]:
    own = NET.states(user)
    covariances = [fix.covariance for fix in fixes]
    sent = np.diag(_sent_variances(heard, user, covariances))
    message = Message(
        heard.innovation, heard.by_state[:, own], heard.noise, sent, frozenset({"sender"})
    )
    fix, gain = fused(fixes[user], message)
    return fix, _corrected(truth, heard, own, gain)


def _sent_variances(heard: Seen, user: int, believed: list[Array]) -> Array:
    """What the senders' own errors add to each range, as they state them."""
    other = heard.by_state.copy()
    other[:, NET.states(user)] = 0
    variances = CONTROLLER_ERROR[0] ** 2 * np.sum(other[:, -3:] ** 2, axis=1)
    for index, covariance in enumerate(believed):
        part = other[:, NET.states(index)]
        variances = variances + np.einsum("mi,ij,mj->m", part, covariance, part)
    return variances


def _of(rows: Seen, user: int) -> Seen:
    """The rows that a user receives."""
    receives = np.flatnonzero(rows.by_state[:, NET.state_of[user, 3]] > 0)
    return _of_row(rows, receives)


def _of_row(rows: Seen, which: int | Array) -> Seen:
    index = np.atleast_1d(which)
    noise = rows.noise[np.ix_(index, index)]
    return Seen(rows.innovation[index], rows.by_state[index], noise, rows.unit[index])


def _corrected(truth: Gaussian, heard: Seen, own: Array, gain: Array) -> Gaussian:
    """The true joint covariance after one user used its gain."""
    whole = np.zeros((NET.size, gain.shape[1]))
    whole[own] = gain
    return corrected(truth, heard.innovation, heard.by_state, heard.noise, whole)


def _told(believed: Array, true: Array) -> tuple[float, float, float, float]:
    place = np.ix_(LEVEL_AND_HEIGHT, LEVEL_AND_HEIGHT)
    level = np.ix_([0, 1], [0, 1])
    excess = np.linalg.eigvals(np.linalg.solve(believed, true)).real.max()
    return (
        2 * float(np.sqrt(np.trace(true[place]))),
        2 * float(np.sqrt(np.trace(believed[place]))),
        float(np.trace(np.linalg.solve(believed[level], true[level]))) / 2,
        float(excess),
    )


def _run(told: list[tuple[float, float, float, float]]) -> Run:
    return Run(*np.array(told).T)


ALL_USERS = np.arange(7 * USERS)


def methods() -> dict[str, Run]:
    """Every method of the page."""
    return {
        "ideal": exact(None, ideal=True),
        "centralised": exact(None),
        "exact two-way": exact(ALL_USERS),
        "exact one-way": exact(ALL_USERS, two_way=False),
        "split intersection": split(),
        "uncorrelated": local(uncorrelated),
        "r = cos": local(cosines),
    }
