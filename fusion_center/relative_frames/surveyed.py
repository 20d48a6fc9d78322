"""Frames that navigation knows so well that no common target need tell them.

Carriers with good receivers, radars on surveyed ground: what is open of their frames is less than
one plot would notice. They are used as they are where the search finds no common target, unless
targets that both should see contradict them.
"""

from __future__ import annotations

import numpy as np

from estimation.arrays import Array
from estimation.frames import yaw_rad
from estimation.relative_frame import in_fixed_axes, prior_in_own_axes
from estimation.tracking.scan import View as Field

from ..state import Estimate, State
from . import corrections
from .common import in_own_axes, told_by_a_plot
from .corrections import Misclosure
from .moment import Moment

WHY_NOT = "targets that both should see do not agree with what navigation says"
_FOLLOWED = 0.5
"""Least probability that what one carrier follows the other does as well, if it can see it."""


def known_beforehand(moment: Moment, name: str) -> Estimate | None:
    """A carrier's frame as navigation has it; None where a plot would notice what is open."""
    prior = moment.prior[name]
    frame = prior_in_own_axes(prior)
    plot = told_by_a_plot(moment.others[name])
    if plot is None:
        return None
    fixed, between = in_fixed_axes(frame, prior), moment.between[name]
    nobody = Misclosure(0, 0.0, 0)
    try:
        found = corrections.estimated(frame, fixed, prior, between, nobody, "joint", plot)
    except (np.linalg.LinAlgError, ValueError):  # its navigation states no covariance that is one
        return None
    return found if found.directions[0].status == "determined" else None


def contradicted(state: State, moment: Moment, name: str) -> bool:
    """Whether it is no chance that carriers whose frame is known have not one target in common."""
    if known_beforehand(moment, name) is None:
        return False
    frame = prior_in_own_axes(moment.prior[name])
    turn_rad = yaw_rad(moment.between[name].own_from_other) + float(frame.D_rad)
    theirs = in_own_axes(moment.others[name], frame).east_north_m
    should = _in_view(state, name, frame.q_m, turn_rad, moment.own.east_north_m)
    should += _in_view(state, state.own, np.zeros(2), 0.0, theirs)
    return bool((1 - _FOLLOWED) ** should < 1 - state.settings.registration.trust)


def _in_view(state: State, name: str, site_m: Array, turn_rad: float, places_m: Array) -> int:
    """How many places (n, 2) in own axes a carrier's sources can see.

    Args:
        site_m: (2,) where it is; turn_rad: what is added to its bearings to get own ones.
    """
    seen = np.zeros(len(places_m), dtype=np.bool_)
    for source in state.sources(name).values():
        start, width = 0.0, 2 * np.pi
        if source.sector is not None:
            start, width = source.sector.start_rad + turn_rad, source.sector.width_rad
        ring = source.range_min_m, source.range_max_m
        seen |= Field(site_m, *ring, start, width).holds(places_m.T)
    return int(seen.sum())
