"""Acquisition: which log is whose, and where the other carrier's frame lies, both at once."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from estimation.acquisition.beam import search
from estimation.acquisition.consensus import consensus
from estimation.acquisition.innovation import Frames
from estimation.acquisition.modes import Candidate, Setting, apart, polished, refined, starts
from estimation.acquisition.problem import Clues, Constraints, problem
from estimation.acquisition.sharing import Sharing
from estimation.arrays import Array, ArrayLike, Indices
from estimation.frames import wrap_pi
from estimation.relative_frame import (
    Direction,
    OwnAxesFrame,
    PolarLogs,
    RelativeFramePrior,
    directions,
    prior_in_own_axes,
)

Status = Literal["acquired", "ambiguous", "undetermined", "nothing"]

_WIDE_RAD = np.radians(12.0)  # sigma of D beyond which places cannot be linearised in it
_FLAT_RAD = 1.0  # sigma of D beyond which every heading is as likely
_ANY_HEADING_RAD = np.pi / np.sqrt(3)  # the sigma of a heading of which nothing is known
_FLAT_VARIANCE = 1e6  # of D in the fit when every heading is as likely
_OF_NOTE = 1e-3  # probability of a mode whose frame is worth refining
_GATE_OF_FRAMES = 25.0  # chi-squared of 3
_LEAST = np.diag([1e-3, 1e-3, 1e-7]) ** 2  # a prior is never surer: it must have an inverse


class Settings(NamedTuple):
    """How hard to search and what to trust.

    Attributes:
        width: hypotheses kept by the beam.
        gate: chi-squared of 2 within which a pair must agree with the prior.
        modes: that are polished and weighed, with a prior.
        blind_modes: the same, of frames voted for without one.
        trust: probability of a mode above which it may be acted upon.
        area_m2: on which targets lie; None: by the spread of the logs.
    """

    width: int = 100
    gate: float = 20.0
    modes: int = 8
    blind_modes: int = 12
    trust: float = 0.99
    area_m2: float | None = None


NOTHING_MORE, UNBOUND, DEFAULTS = Clues(), Constraints(), Settings()


class Mode(NamedTuple):
    """One way in which the two pictures may lie upon each other.

    Attributes:
        own, other: (K,) indices of the paired logs.
        pair_probability: (K,) that a pair is right when the mode is.
        frame: (q, D) of own axes and its covariance, given the mode.
        probability: of the mode.
    """

    own: Indices
    other: Indices
    pair_probability: Array
    frame: OwnAxesFrame
    probability: float


class Acquisition(NamedTuple):
    """What could be found out.

    Attributes:
        modes: the most probable first; may be empty.
        nothing_probability: that no mode is true, for want of a common target.
        status: acquired: one mode is trusted and determines every direction of (q, D), the only
            one to be acted upon; undetermined: trusted but leaves a direction to the prior;
            ambiguous: no mode is trusted; nothing: that no log is common is the likeliest.
        sentence: the status in words, with its reason.
        directions: of the first mode against the prior, the weakest first; empty without a mode.
    """

    modes: tuple[Mode, ...]
    nothing_probability: float
    status: Status
    sentence: str
    directions: tuple[Direction, ...]


def acquire(
    own: PolarLogs,
    other: PolarLogs,
    prior: RelativeFramePrior,
    clues: Clues = NOTHING_MORE,
    known: Constraints = UNBOUND,
    settings: Settings = DEFAULTS,
) -> Acquisition:
    """Associate and register two carriers' logs of one instant when no log says whose it is.

    A beam search over pairs with the error of the frame integrated out; the modes it ends in are
    polished and weighed. With a heading known worse than 12 deg it is `acquire_blind`.

    Args:
        own: (N1,) logs in own axes, of targets and of clutter; ranges above zero.
        other: (N2,) in the other carrier's axes, in any order.
        prior: what navigation says of the frame (one, no batch).
        clues: velocities, features.
        known: pairs that must be or must not be.
    """
    before = prior_in_own_axes(prior)
    if before.covariance[2, 2] > _WIDE_RAD**2:
        return acquire_blind(own, other, _spread_over(prior), clues, known, settings)
    if not (own.count and other.count):
        return _no_logs(own)
    setting = _setting(own, other, before, clues, known, settings)
    first = setting.sharing.worth_at_first
    found = search(setting.given, setting.prior, first, settings.gate, settings.width)
    return _judged(setting, starts(found.frames, found.score, settings.modes), settings)


def acquire_blind(
    own: PolarLogs,
    other: PolarLogs,
    prior: OwnAxesFrame,
    clues: Clues = NOTHING_MORE,
    known: Constraints = UNBOUND,
    settings: Settings = DEFAULTS,
) -> Acquisition:
    """`acquire` when the heading is unknown, and the place perhaps: equal distances vote.

    Args:
        own: (N1,) logs in own axes.
        other: (N2,) in the other carrier's axes, in any order.
        prior: of (q, D); a sigma of D above a radian is taken as no knowledge. See `unknown_frame`.
        clues: velocities, features.
        known: pairs that must be or must not be.
    """
    if not (own.count and other.count):
        return _no_logs(own)
    setting = _setting(own, other, prior, clues, known, settings)
    voted = consensus(setting.given, setting.prior, settings.blind_modes, _GATE_OF_FRAMES)
    return _judged(setting, voted if len(voted.t) else setting.prior, settings)


def unknown_frame(sigma_q_m: float, q_m: ArrayLike = (0.0, 0.0)) -> OwnAxesFrame:
    """A prior for `acquire_blind`: any heading, the other carrier within `sigma_q_m` of q."""
    variances = [sigma_q_m**2, sigma_q_m**2, _ANY_HEADING_RAD**2]
    return OwnAxesFrame(np.asarray(q_m, dtype=float), np.zeros(()), np.diag(variances))


def _spread_over(prior: RelativeFramePrior) -> OwnAxesFrame:
    """(q, D) of norths so uncertain that q lies on an arc: the moments of that arc, any axis."""
    c1, c2 = np.square(prior.sigma_c1_rad), np.square(prior.sigma_c2_rad)
    shrunk = float(np.exp(-c1))  # E cos^2 - E sin^2 of the turn, and the square of its mean
    offset = prior.offset_m
    variance = (np.trace(prior.offset_covariance) + (offset @ offset) * (1 - shrunk)) / 2
    turn = min(float(c1 + c2), _ANY_HEADING_RAD**2)
    covariance = np.diag([variance, variance, turn])
    return OwnAxesFrame(offset * np.sqrt(shrunk), np.zeros(()), covariance)


def _setting(
    own: PolarLogs,
    other: PolarLogs,
    before: OwnAxesFrame,
    clues: Clues,
    known: Constraints,
    settings: Settings,
) -> Setting:
    """The problem with its prior as arrays; a flat heading is a density of 1 / (2 pi)."""
    given = problem(own, other, clues, known, settings.area_m2)
    t = np.concatenate([before.q_m, np.reshape(before.D_rad, 1)])
    covariance = before.covariance + _LEAST
    peak = -0.5 * float(np.linalg.slogdet(2 * np.pi * covariance)[1])
    weight, flat = covariance, bool(covariance[2, 2] > _FLAT_RAD**2)
    if flat:
        peak = -0.5 * float(np.linalg.slogdet(2 * np.pi * covariance[:2, :2])[1])
        peak -= float(np.log(2 * np.pi))
        weight = covariance + np.diag([0.0, 0.0, _FLAT_VARIANCE])
    sharing = Sharing.of(own.count, other.count, given.area_m2)
    return Setting(given, Frames(t[None], weight[None]), peak, sharing, covariance, flat)


def _judged(setting: Setting, tries: Frames, settings: Settings) -> Acquisition:
    """Polish every try, weigh the modes they end in against each other and against nothing."""
    ends = (polished(setting, tries.take(np.array([k]))) for k in range(len(tries.t)))
    found = [c for c in apart(list(ends)) if c.pairs.own.size and np.isfinite(c.log_evidence)]
    bound = found and setting.given.bound.size
    nothing = -np.inf if bound else 0.0  # a bound pair is not nothing
    evidence = np.array([nothing, *(c.log_evidence for c in found)])
    chance = np.exp(evidence - evidence.max())
    chance /= chance.sum()
    modes = tuple(_mode(setting, c, float(p)) for c, p in zip(found, chance[1:], strict=True))
    informed = directions(modes[0].frame.covariance, setting.covariance) if modes else []
    status, sentence = _status(modes, float(chance[0]), informed, settings.trust)
    return Acquisition(modes, float(chance[0]), status, sentence, tuple(informed))


def _mode(setting: Setting, found: Candidate, probability: float) -> Mode:
    """A candidate as it is told."""
    told = refined(setting, found) if probability > _OF_NOTE else found
    t, covariance = told.frame.t[0], setting.closed(told.frame.covariance[0])
    frame = OwnAxesFrame(t[:2], wrap_pi(t[2]), covariance)
    return Mode(*told.pairs, told.pair_probability, frame, probability)


def _status(
    modes: tuple[Mode, ...], nothing: float, informed: list[Direction], trust: float
) -> tuple[Status, str]:
    """What may be done with the modes, and why, in words."""
    if not modes:
        return "nothing", "no pair of logs agrees with what is known of the frame"
    best = modes[0]
    pairs = f"{best.own.size} pair" + "s" * (best.own.size != 1)
    weakest = informed[0]
    if nothing > best.probability:
        return "nothing", f"most probably ({nothing:.2g}) the carriers have no target in common"
    if best.probability <= trust:
        return "ambiguous", (
            f"{len(modes)} ways to lay the pictures on each other; the likeliest, with {pairs}, "
            f"has probability {best.probability:.2g}"
        )
    if weakest.status != "determined":
        return "undetermined", f"{pairs}, but {weakest}"
    return "acquired", f"{pairs}, probability {best.probability:.4f}; weakest: {weakest}"


def _no_logs(own: PolarLogs) -> Acquisition:
    side = "other" if own.count else "own"
    return Acquisition((), 1.0, "nothing", f"the {side} carrier has no target log", ())
