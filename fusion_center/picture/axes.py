"""The axes of the picture: east-north at the scenario's origin, as the own carrier believes it.

A place is first put along the own carrier's axes by the correction of the carrier that reported
it, then along those of the picture by the own carrier's reported pose, through ECEF: what own
navigation gets wrong moves the whole picture and nothing in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimation.arrays import Array, transposed
from estimation.frames import (
    RigidTransform,
    Site,
    on_surface,
    rotation_clockwise,
    target_from_source,
    wrap_pi,
    yaw_rad,
)
from estimation.relative_frame import OwnAxesFrame
from estimation.tracking.innovations import Common

from ..group import chosen
from ..navigation import pose_at, site
from ..relative_frames import corrections, frames
from ..relative_frames.links import navigated
from ..state import State


@dataclass(frozen=True, eq=False)
class Placed:
    """How the axes of a carrier lie in the picture at an instant.

    Attributes:
        site: the carrier's reported place; `own` its own carrier's.
        own_from_carrier: known transform of their planes; None for the own carrier.
        frame: the correction in own axes; None for the own carrier.
        picture_from_own: known transform of the own plane to the picture.
    """

    site: Site
    own: Site
    own_from_carrier: RigidTransform | None
    frame: OwnAxesFrame | None
    picture_from_own: RigidTransform

    @property
    def turn_rad(self) -> float:
        """What is added to the carrier's bearings to get bearings of the picture."""
        turn: float = yaw_rad(self.picture_from_own)
        if self.own_from_carrier is not None and self.frame is not None:
            turn += yaw_rad(self.own_from_carrier) + float(self.frame.D_rad)
        return float(wrap_pi(turn))

    def place_m(self) -> Array:
        """(2,) where the carrier is."""
        return self._place_m

    @cached_property
    def _place_m(self) -> Array:
        place: Array = self.places_m(np.zeros((1, 2)), np.full(1, self.site.altitude_m))[0]
        return place

    def places_m(self, east_north_m: Array, altitude_m: Array) -> Array:
        """(n, 2) of points (n, 2) east and north of the carrier along its axes."""
        seen = east_north_m
        if self.own_from_carrier is not None and self.frame is not None:
            enu = on_surface(self.site, seen[:, 0], seen[:, 1], altitude_m)
            seen = enu @ self.own_from_carrier.rotation[:2].T
            seen = self.frame.q_m + seen @ rotation_clockwise(self.frame.D_rad).T
        enu = on_surface(self.own, seen[:, 0], seen[:, 1], altitude_m)
        return self.picture_from_own.apply(enu)[:, :2]

    def turned(self, covariance: Array) -> Array:
        """Covariances (n, 2, 2) along the axes of the picture."""
        turn = rotation_clockwise(self.turn_rad)
        return np.asarray(turn @ covariance @ turn.T)

    def common(self, name: str = "") -> Common | None:
        """What the correction leaves unsure of every place alike, along the picture's axes.

        Args:
            name: under which tracks remember it.
        """
        if self.frame is None:
            return None
        turn = np.eye(3)
        turn[:2, :2] = rotation_clockwise(yaw_rad(self.picture_from_own))
        return Common(turn @ self.frame.covariance @ transposed(turn), self.place_m(), name)


def placed(state: State, carrier: str, t_ns: int) -> Placed | None:
    """How a carrier lies in the picture; None while its frame may not be used or is no number."""
    try:
        axes = _placed(state, carrier, t_ns)
    except (np.linalg.LinAlgError, ValueError):
        return None
    return axes if axes and np.isfinite([*axes.place_m(), axes.turn_rad]).all() else None


def _placed(state: State, carrier: str, t_ns: int) -> Placed | None:
    own_messages = state.carriers[state.own].navigation if state.own in state.carriers else ()
    if not own_messages or _holds_unknown(state, carrier):
        return None
    own = site(pose_at(own_messages, t_ns))
    origin = state.scenario.origin
    there = Site(origin.latitude_rad, origin.longitude_rad, origin.altitude_m)
    picture_from_own = target_from_source(there, own)
    if carrier == state.own:
        return Placed(own, own, None, None, picture_from_own)
    frame = _frame(state, carrier, t_ns)
    if frame is None:
        return None
    between, _ = navigated(state, carrier, t_ns)
    return Placed(site(between.other), own, between.own_from_other, frame, picture_from_own)


def _holds_unknown(state: State, carrier: str) -> bool:
    """Whether a carrier has a frame that nobody knows: what is known of a correction is out."""
    messages = state.carriers[carrier].navigation if carrier in state.carriers else ()
    return any(message.correction_id for message in messages[-1:])


def _frame(state: State, carrier: str, t_ns: int) -> OwnAxesFrame | None:
    """An applied correction at an instant."""
    counts, by_group = chosen.frame(state, carrier, t_ns)
    if counts:
        return by_group
    link = state.links.get(carrier)
    if link is None or link.monitor.state != "applied" or link.estimate is None:
        return None
    carried = frames.carried_to(state, t_ns)
    if carried is not None and carrier in carried.carriers:
        return frames.frame_of(carried, carrier)
    _, prior = navigated(state, carrier, t_ns)
    return corrections.at(link.estimate, prior)
