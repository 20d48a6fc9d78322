"""The named baselines: each other carrier against the own one, by the pairs of one instant.

Whenever both have reported since their last registration, the other's frame is registered anew, at
the later of the two instants (where reports alternate, each is paired with the nearer neighbour).
Targets are those that bear one identity or that an operator has bound; once a correction is
applied, also those that lie together.
"""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from ..navigation import NS, way_m
from ..quality import MOST_NIS, Tally
from ..sources.sightings import Sightings, sightings
from ..state import Estimate, Link, State
from . import association, corrections, monitor, registration
from .links import navigated, obstacle
from .monitor import MAX_REASON


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
    frame = corrections.at(applied, prior) if applied else None
    gate = state.settings.association.gate
    pairs = association.associate(own, other, state.orders, frame, gate)
    pairs = registration.with_bearings(pairs, own, other)
    found, nis = None, np.zeros(0)
    if pairs:
        method = state.settings.registration.method
        found, nis = registration.register(own, other, pairs, prior, between, method)
        found = corrections.within_bounds(found)
        nis = np.nan_to_num(nis, nan=MOST_NIS).clip(0.0, MOST_NIS)
    tally.registered((state.own, name), own, other, pairs, nis)
    return found
