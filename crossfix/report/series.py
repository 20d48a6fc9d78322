"""What each correction said over time, beside what it should have said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import nan
from typing import NamedTuple

import numpy as np

from crossfix.evaluation import FrameError, frame_errors, symmetric
from estimation.arrays import Array
from schemas.messages import Correction

from .story import Story

NO_OWN_AXES = (nan, nan, nan)


class Span(NamedTuple):
    """A state that held from one instant to another [s]."""

    name: str
    from_s: float
    to_s: float


class FrameSeries(NamedTuple):
    """The corrections of one carrier, one a Closed; columns are east [m], north [m], turn [rad].

    Attributes:
        estimate: (n, 3) what is added to the reported place and to its bearings; nan before there
            is any.
        sigma: (n, 3) claimed.
        truth: (n, 3) what should be added; nan where no truth is known.
        nees: (n,) of three degrees of freedom.
        pairs: (n,) associated pairs used; chi2: (n,) of their misclosures over `dof` (n,).
        ratios: (n, 3) posterior over prior sigma of the directions, from the weakest on.
        states: one after the other.
        errors: as `evaluation` has them.
        place_covariance: (2, 2) of east and north as claimed, mean over the second half of the
            estimates; nan where there are none.
    """

    carrier: str
    t_s: Array
    estimate: Array
    sigma: Array
    truth: Array
    nees: Array
    pairs: Array
    chi2: Array
    dof: Array
    ratios: Array
    states: Sequence[Span]
    errors: Sequence[FrameError]
    last: Correction
    place_covariance: Array

    @property
    def error(self) -> Array:
        """What remains (n, 3): estimate less truth, the turn within half a turn."""
        error = self.estimate - self.truth
        error[:, 2] = (error[:, 2] + np.pi) % (2 * np.pi) - np.pi
        return error


def frame_series(story: Story) -> list[FrameSeries]:
    """Of every carrier that was to be corrected."""
    errors = _errors(story)
    return [
        _series(story, name, story.corrections[name], errors.get(name, []))
        for name in story.others
        if story.corrections.get(name)
    ]


def _errors(story: Story) -> Mapping[str, Sequence[FrameError]]:
    """Errors of all corrections of carriers whose truth is known."""
    if not story.has_truth:
        return {}
    known = story.truth_carriers[0].carrier
    corrections = [
        c for name in story.others if name in known for c in story.corrections.get(name, ())
    ]
    return frame_errors(story.scenario, story.own, [*story.truth_carriers, *corrections])


def _series(
    story: Story, carrier: str, corrections: Sequence[Correction], errors: Sequence[FrameError]
) -> FrameSeries:
    by_step = {error.step: error for error in errors}
    found = [by_step.get(c.step) for c in corrections]
    said = [_said(c) for c in corrections]
    return FrameSeries(
        carrier=carrier,
        t_s=np.array([story.time_s(c.t_ns) for c in corrections]),
        estimate=np.array([estimate for estimate, _ in said]),
        sigma=np.array([sigma for _, sigma in said]),
        truth=np.array([_truth(error) for error in found]),
        nees=np.array([error.nees if error else nan for error in found]),
        pairs=np.array([float(c.pairs) for c in corrections]),
        chi2=np.array([c.chi2 if c.dof else nan for c in corrections]),
        dof=np.array([float(c.dof) for c in corrections]),
        ratios=np.array([_ratios(c) for c in corrections]),
        states=_states(story, corrections),
        errors=errors,
        last=corrections[-1],
        place_covariance=_place_covariance(corrections),
    )


def _said(correction: Correction) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Estimate and sigma of one correction."""
    own = correction.own_axes
    if own is None:
        return NO_OWN_AXES, NO_OWN_AXES
    east, north = own.east_m - own.reported_east_m, own.north_m - own.reported_north_m
    variances = (own.covariance[0], own.covariance[3], own.covariance[5])
    return (east, north, own.rotation_rad), tuple(float(v) ** 0.5 for v in variances)


def _ratios(correction: Correction) -> tuple[float, ...]:
    found = [direction.ratio for direction in correction.directions]
    return (*found, *NO_OWN_AXES)[: len(NO_OWN_AXES)]


def _place_covariance(corrections: Sequence[Correction]) -> Array:
    claimed = [c.own_axes.covariance for c in corrections if c.own_axes is not None]
    if not claimed:
        return np.full((2, 2), nan)
    mean = np.mean(claimed[len(claimed) // 2 :], axis=0)
    return symmetric(mean)[:2, :2]


def _truth(error: FrameError | None) -> tuple[float, float, float]:
    if error is None:
        return NO_OWN_AXES
    return -error.before_m[0], -error.before_m[1], -error.before_rad


def _states(story: Story, corrections: Sequence[Correction]) -> list[Span]:
    """States one after the other, each to the beginning of the next, the last to the end."""
    spans: list[Span] = []
    for correction in corrections:
        now_s = story.time_s(correction.t_ns)
        if spans and spans[-1].name == correction.state:
            continue
        if spans:
            spans[-1] = spans[-1]._replace(to_s=now_s)
        spans.append(Span(correction.state, now_s, now_s))
    spans[-1] = spans[-1]._replace(to_s=story.time_s(story.end_ns))
    return spans


def presence(story: Story) -> dict[str, list[Span]]:
    """When each carrier took part, by the Closed messages."""
    spans: dict[str, list[Span]] = {name: [] for name in story.carriers}
    for closed in story.closings:
        now_s = story.time_s(closed.t_ns)
        for name in closed.lost:
            if spans.get(name):
                spans[name][-1] = spans[name][-1]._replace(to_s=now_s)
        for name in closed.joined:
            spans.setdefault(name, []).append(Span(name, now_s, story.time_s(story.end_ns)))
    return {name: found or _heard(story, name) for name, found in spans.items()}


def _heard(story: Story, carrier: str) -> list[Span]:
    """From first to last navigation of a carrier that no Closed says has joined."""
    times = [story.time_s(message.t_ns) for message in story.navigation.get(carrier, ())]
    return [Span(carrier, min(times), max(times))] if times else []
