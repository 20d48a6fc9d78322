"""The own carrier and one other: what stands in the way of a correction, and how one is made."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from math import hypot

import numpy as np
from msgspec.structs import replace

from estimation.relative_frame import RelativeFramePrior
from schemas.messages.outputs import CorrectionState

from . import association, monitor, registration
from .navigation import NS, carried_sigma_m, frame_covariance, pose_at, way_m
from .quality import Tally
from .registration import Poses
from .sightings import Sightings, sightings
from .state import CarrierState, Estimate, Link, Monitor, State

MAX_REASON = 200
MOST_NIS = 1e12
Obstacle = tuple[CorrectionState, str]


def obstacle(state: State, other: str, t_ns: int) -> Obstacle | None:
    """Why a carrier's frame is not registered at all at an instant; None when it is."""
    if state.carriers.get(state.own, CarrierState()).lost:
        return "suspended", f"the own carrier {state.own} is lost: its frame is predicted on"
    if state.carriers.get(other, CarrierState()).lost:
        return "suspended", f"{other} is lost"
    if other in state.orders.suspended:
        return "suspended", "by order of the operator"
    return next((o for name in (state.own, other) for o in _not_placed(state, name, t_ns)), None)


def _not_placed(state: State, name: str, t_ns: int) -> Iterator[Obstacle]:
    """Why a carrier or its targets cannot be placed; only the first reason is to be asked for."""
    carrier, sources = state.carriers.get(name, CarrierState()), state.sources(name)
    if not carrier.boot:
        yield "off", f"{name} has not been heard yet"
    if not sources:
        yield "off", f"no SourceInfo of {name} yet"
    if all(source.coordinates == "bearing" for source in sources.values()):
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


class Views:
    """Sightings of carriers at instants, each made once."""

    def __init__(self, state: State) -> None:
        self._state = state
        self._seen: dict[tuple[str, int], Sightings] = {}

    def __call__(self, name: str, t_ns: int) -> Sightings:
        """All targets of a carrier at an instant."""
        if (name, t_ns) not in self._seen:
            carrier = self._state.carriers[name]
            way = way_m(carrier.navigation, t_ns)
            self._seen[name, t_ns] = sightings(
                name, carrier.boot, carrier.logs, t_ns, way, self._state.settings.logs
            )
        return self._seen[name, t_ns]


def with_registrations(state: State, tally: Tally) -> State:
    """The state after every carrier has been registered with which the own one shares news."""
    views = Views(state)
    links = {
        name: _after_news(state, name, link, views, tally) if _is_due(state, name, link) else link
        for name, link in sorted(state.links.items())
    }
    return replace(state, links=links)


def _is_due(state: State, name: str, link: Link) -> bool:
    """Whether both carriers have news, and better company for the older is not about to come.

    When more than half a period lies between the two reports, the next of the earlier carrier will
    be nearer to the later one than this: extrapolation stays within half a period. One that is
    overdue is not waited for.
    """
    if not (link.own_news and link.other_news):
        return False
    earlier, later = sorted((state.own, name), key=lambda c: state.carriers[c].report_t_ns)
    gap_s = (state.carriers[later].report_t_ns - state.carriers[earlier].report_t_ns) * NS
    periods_s = [s.period_s for s in state.sources(earlier).values() if s.coordinates != "bearing"]
    period_s = min(periods_s, default=0.0)
    return not period_s / 2 < gap_s < period_s


def _after_news(state: State, name: str, link: Link, views: Views, tally: Tally) -> Link:
    """One report event: associate, register, judge."""
    t_ns = max(state.carriers[c].report_t_ns for c in (state.own, name))
    if (reason := obstacle(state, name, t_ns)) is not None:
        return Link(estimate=link.estimate if reason[0] == "suspended" else None)
    try:
        with np.errstate(all="ignore"):  # numbers from the wire may be anything within its bounds
            found = _registered(state, name, link, views, tally, t_ns)
        why_none = "no pair of logs"
    except (np.linalg.LinAlgError, ValueError) as error:
        found, why_none = None, f"no frame comes out of these numbers: {error}"[:MAX_REASON]
    judged, adopted = monitor.after_registration(
        link.monitor, found, state.settings.monitor, why_none
    )
    return Link(monitor=judged, estimate=found if adopted else link.estimate)


def _registered(
    state: State, name: str, link: Link, views: Views, tally: Tally, t_ns: int
) -> Estimate | None:
    """Associate and register; None where there is no pair.

    Raises:
        LinAlgError, ValueError: covariances or places so extreme that nothing can be computed, or
            that what comes out is not of this planet.
    """
    between, prior = navigated(state, name, t_ns)
    own = views(state.own, t_ns)
    other = registration.in_own_plane(views(name, t_ns), between)
    applied = link.estimate if link.monitor.state == "applied" else None
    frame = registration.at(applied, prior) if applied else None
    gate = state.settings.association.gate
    pairs = association.associate(own, other, state.orders, frame, gate)
    pairs = registration.with_bearings(pairs, own, other)
    found, nis = None, np.zeros(0)
    if pairs:
        method = state.settings.registration.method
        found, nis = registration.register(own, other, pairs, prior, between, method)
        found = registration.within_bounds(found)
        nis = np.nan_to_num(nis, nan=MOST_NIS).clip(0.0, MOST_NIS)
    tally.registered((state.own, name), own, other, pairs, nis)
    return found


def navigated(state: State, other: str, t_ns: int) -> tuple[Poses, RelativeFramePrior]:
    """Where navigation puts the own carrier and another at an instant, and how sure it is.

    Both must have navigation and a stated covariance, see `obstacle`.
    """
    poses, covariances = [], []
    for name in (state.own, other):
        pose = pose_at(state.carriers[name].navigation, t_ns)
        covariance = frame_covariance(pose, state.declared(name))
        if covariance is None:
            raise ValueError(f"nothing says how sure the pose of {name} is")
        poses.append(pose)
        covariances.append(covariance)
    between = registration.poses(t_ns, *poses)
    return between, registration.prior_of(between, *covariances)


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
    predicted = registration.predicted(estimate, prior, between, hypot(*astray))
    return registration.within_bounds(predicted)
