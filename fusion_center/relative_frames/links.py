"""The own carrier and one other: what stands in the way of a correction, and what is published."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from math import hypot

import numpy as np

from estimation.relative_frame import RelativeFramePrior
from estimation.relative_frame.situation import TWO_BEARING_ONLY
from schemas.messages.outputs import CorrectionState

from ..navigation import NS, carried_sigma_m, frame_covariance, pose_at
from ..state import CarrierState, Estimate, Link, Monitor, State
from . import corrections, registration
from .corrections import Poses

Obstacle = tuple[CorrectionState, str]


def obstacle(state: State, other: str, t_ns: int) -> Obstacle | None:
    """Why a carrier's frame is not registered at all at an instant; None when it is."""
    if state.carriers.get(state.own, CarrierState()).lost:
        return "suspended", f"the own carrier {state.own} is lost: its frame is predicted on"
    if state.carriers.get(other, CarrierState()).lost:
        return "suspended", f"{other} is lost"
    if other in state.orders.suspended:
        return "suspended", "by order of the operator"
    passive = sees_bearings_only(state, other)
    over_time = passive and state.links.get(other, Link()).bearings_t_ns >= 0
    if passive and not over_time and sees_bearings_only(state, state.own):
        return "off", TWO_BEARING_ONLY
    names = (state.own, other)
    return next((o for name in names for o in _not_placed(state, name, t_ns, over_time)), None)


def sees_bearings_only(state: State, name: str) -> bool:
    """Whether all that a carrier measures of targets are bearings."""
    sources = state.sources(name).values()
    return bool(sources) and all(source.coordinates == "bearing" for source in sources)


def _not_placed(state: State, name: str, t_ns: int, over_time: bool) -> Iterator[Obstacle]:
    """Why a carrier or its targets cannot be placed; only the first reason is to be asked for.

    Args:
        over_time: bearings are enough, there being many.
    """
    carrier, sources = state.carriers.get(name, CarrierState()), state.sources(name)
    if not carrier.boot:
        yield "off", f"{name} has not been heard yet"
    if not sources:
        yield "off", f"no SourceInfo of {name} yet"
    if not over_time and sees_bearings_only(state, name):
        yield "off", f"{name} reports bearings only: no positions to compare"
    if not carrier.navigation:
        yield "off", f"no navigation of {name} yet"
    newest = carrier.navigation[-1]
    if frame_covariance(newest.pose, state.declared(name)) is None:
        yield "off", f"neither {name} nor the scenario says how sure its pose is"
    if newest.correction_id:
        yield "suspended", f"the navigation of {name} already holds {newest.correction_id}"
    age_s = (t_ns - newest.t_ns) * NS
    if age_s > state.settings.navigation.max_age_s:
        yield "suspended", f"the navigation of {name} is {age_s:.3g} s old"


def navigated(state: State, other: str, t_ns: int) -> tuple[Poses, RelativeFramePrior]:
    """Where navigation puts the own carrier and another at an instant, and how sure it is.

    Frames are of sensors: what a source adds to all its bearings turns them as north does.

    Both must have navigation and a stated covariance, see `obstacle`.
    """
    poses, covariances = [], []
    for name in (state.own, other):
        pose = pose_at(state.carriers[name].navigation, t_ns)
        covariance = frame_covariance(pose, state.declared(name))
        if covariance is None:
            raise ValueError(f"nothing says how sure the pose of {name} is")
        poses.append(pose)
        covariances.append(covariance + np.diag([0.0, 0.0, _azimuth_variance(state, name)]))
    between = corrections.poses(t_ns, *poses)
    return between, registration.prior_of(between, *covariances)


def _azimuth_variance(state: State, name: str) -> float:
    """What a carrier's source declares of its bearings' common error; of several the largest."""
    sources = state.sources(name).values()
    return max((source.sigma_azimuth_bias_rad**2 for source in sources), default=0.0)


def status(state: State, other: str, t_ns: int) -> tuple[Monitor, Estimate | None]:
    """What is to be published of a carrier at a closing.

    When the own carrier is lost its frame is predicted on with its last navigation, and with it
    where the other carrier lies in it.
    """
    link = state.links[other]
    reason = obstacle(state, other, t_ns)
    if reason is None:
        return link.monitor, link.estimate
    blocked = Monitor(state=reason[0], reason=reason[1])
    if reason[0] == "off":
        return blocked, None
    own = state.carriers.get(state.own, CarrierState())
    if own.lost and link.estimate is not None:
        with suppress(np.linalg.LinAlgError, ValueError), np.errstate(all="ignore"):
            return blocked, _predicted(state, other, link.estimate, t_ns)
    return blocked, link.estimate


def _predicted(state: State, other: str, estimate: Estimate, t_ns: int) -> Estimate:
    """The last estimate carried on with the navigation of both carriers.

    Raises:
        LinAlgError, ValueError: their navigation is not of this planet.
    """
    between, prior = navigated(state, other, t_ns)
    sigma = state.settings.navigation.sigma_speed_mps
    astray = [
        carried_sigma_m(state.carriers[c].navigation, t_ns, sigma) for c in (state.own, other)
    ]
    predicted = corrections.predicted(estimate, prior, between, hypot(*astray))
    return corrections.within_bounds(predicted)
