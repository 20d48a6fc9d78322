"""A frame that is not yet known: searched for at a report event, and perhaps found."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.relative_frame import OwnAxesFrame, PolarLogs, robust_adjustment
from estimation.relative_frame.situation import reasons

from . import corrections, frames, monitor, registration, search
from .association import Pair
from .moment import Moment
from .monitor import MAX_REASON
from .quality import MOST_NIS, Tally
from .state import Estimate, Link, State

EAGER, PATIENT = 10, 5
"""Searches in vain after which only every so many events are tried."""
MAJORITY = 2 / 3
"""Share of pairs that must agree before the others are taken for wrong."""


class Start(NamedTuple):
    """A frame found by itself.

    Attributes:
        pairs: behind it; nis: (L,) of each.
    """

    frame: OwnAxesFrame
    estimate: Estimate
    pairs: list[Pair]
    nis: Array


def with_search(state: State, moment: Moment, name: str, tally: Tally) -> State:
    """The state after a carrier's frame has been searched for."""
    link: Link = replace(state.links[name], events=state.links[name].events + 1)
    if link.tries >= EAGER and link.events % PATIENT:
        return _with(state, name, link)
    found, start, remark = _tried(state, moment, name)
    estimate = start.estimate if start else None
    judged, _ = monitor.after_registration(
        link.monitor, estimate, state.settings.monitor, found.sentence[:MAX_REASON], remark
    )
    pairs, nis = (start.pairs, start.nis) if start else ([], np.zeros(0))
    tally.registered((state.own, name), moment.own, moment.others[name], pairs, nis)
    link = replace(link, monitor=judged, estimate=estimate, tries=link.tries + 1)
    if start is None or monitor.is_excessive(start.estimate, state.settings.monitor):
        return _with(state, name, link)
    link = replace(
        link,
        followed=True,
        found_t_ns=moment.t_ns,
        mode_probability=found.probability,
        tries=0,
        doubts=0,
        watch=None,
    )
    found_frames = frames.joined_by(state, state.frames, name, start.frame, moment.t_ns)
    return _with(replace(state, frames=found_frames), name, link)


def _tried(state: State, moment: Moment, name: str) -> tuple[search.Found, Start | None, str]:
    """What a search came to, the frame where there is one, and what the geometry hides."""
    settings = state.settings.registration
    other, prior = moment.others[name], moment.prior[name]
    try:
        found = search.searched(moment.own, other, prior, state.orders, settings)
        if not found.pairs:
            return found, None, ""
        start = _start(state, moment, name, found)
    except (np.linalg.LinAlgError, ValueError) as error:
        return search.Found([], 0.0, f"no frame comes out of these numbers: {error}"), None, ""
    return found, start, "; ".join(reasons(*_polar(moment, name, start.pairs)))


def _start(state: State, moment: Moment, name: str, found: search.Found) -> Start:
    """The frame of the pairs that were found; without the wrong ones, as long as they are few."""
    start = _adjusted(moment, name, found.pairs)
    if monitor.is_excessive(start.estimate, state.settings.monitor):
        kept = robust_adjustment(*_polar(moment, name, found.pairs), moment.prior[name]).kept
        if kept.mean() >= MAJORITY:
            right = [pair for pair, stays in zip(found.pairs, kept, strict=True) if stays]
            start = _adjusted(moment, name, right)
    estimate = replace(
        start.estimate,
        method="joint",
        mode_probability=found.probability,
        since_t_ns=moment.t_ns,
    )
    return start._replace(estimate=estimate)


def _adjusted(moment: Moment, name: str, pairs: list[Pair]) -> Start:
    estimate, nis = registration.register(
        moment.own, moment.others[name], pairs, moment.prior[name], moment.between[name],
        "adjustment",
    )  # fmt: skip
    estimate = corrections.within_bounds(estimate)
    nis = np.nan_to_num(nis, nan=MOST_NIS).clip(0.0, MOST_NIS)
    return Start(corrections.frame_of(estimate), estimate, pairs, nis)


def _polar(moment: Moment, name: str, pairs: list[Pair]) -> tuple[PolarLogs, PolarLogs]:
    own, other = moment.own, moment.others[name]
    mine, theirs = [pair.own for pair in pairs], [pair.other for pair in pairs]
    return (
        PolarLogs.from_east_north(own.east_north_m[mine], own.covariance[mine]),
        PolarLogs.from_east_north(other.east_north_m[theirs], other.covariance[theirs]),
    )


def _with(state: State, name: str, link: Link) -> State:
    return replace(state, links={**state.links, name: link})
