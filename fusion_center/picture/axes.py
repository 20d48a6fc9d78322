"""The axes of the picture: east-north at the scenario's origin, as the own carrier believes it.

A place is first put along the own carrier's axes by the correction of the carrier that reported
it, then along those of the picture by the own carrier's reported pose, through ECEF: what own
navigation gets wrong moves the whole picture and nothing in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

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
from estimation.relative_frame.joint import LOGS, WIDTH
from estimation.relative_frame.range_errors import NO_RANGE_ERRORS, RangeErrors
from estimation.tracking.frame_errors import SIZE
from estimation.tracking.innovations import Common, Together

from ..group import chosen
from ..navigation import pose_at, site
from ..relative_frames import corrections, frames
from ..relative_frames.links import navigated
from ..state import Frames, State


class Unsure(NamedTuple):
    """What is not known of where a carrier's plots lie, as one covariance.

    Attributes:
        covariance: (K, K) of the frame's (q, D) along own axes, and of (b, s) of each source.
        ranges: of each source whose ranges err, the first of its rows, and what is to be added.
    """

    covariance: Array
    ranges: dict[str, tuple[int, RangeErrors]]


@dataclass(frozen=True, eq=False)
class Placed:
    """How the axes of a carrier lie in the picture at an instant.

    Attributes:
        site: the carrier's reported place; `own` its own carrier's.
        own_from_carrier: known transform of their planes; None for the own carrier.
        frame: the correction in own axes; None for the own carrier.
        picture_from_own: known transform of the own plane to the picture.
        unsure: None where nothing is, as of an own carrier whose ranges are right.
        together: the same with that of all frames that are followed together.
    """

    site: Site
    own: Site
    own_from_carrier: RigidTransform | None
    frame: OwnAxesFrame | None
    picture_from_own: RigidTransform
    unsure: Unsure | None = None
    together: Together | None = None

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

    def ranges(self, source: str) -> RangeErrors:
        """What is to be added to the ranges of a source."""
        known = self.unsure.ranges if self.unsure else {}
        return known[source][1] if source in known else NO_RANGE_ERRORS

    def common(self, name: str = "", source: str = "") -> Common | None:
        """What is unsure of all places of a source alike, along the picture's axes.

        Args:
            name: under which tracks remember it.
            source: whose ranges are meant; empty = only the frame is.
        """
        if self.unsure is None or (self.frame is None and not name):
            return None
        covariance = self.unsure.covariance if name else self.unsure.covariance[:SIZE, :SIZE]
        turn = np.eye(len(covariance))
        turn[:2, :2] = rotation_clockwise(yaw_rad(self.picture_from_own))
        first, _ = self.unsure.ranges.get(source, (0, NO_RANGE_ERRORS))
        covariance = turn @ covariance @ transposed(turn)
        return Common(covariance, self.place_m(), name, ranges=first, together=self.together)


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
    planes = own, picture_from_own
    if carrier == state.own:
        unsure = _unsure(state, carrier, np.zeros((SIZE, SIZE)), state.frames)
        if not unsure.ranges:
            return Placed(own, own, None, None, picture_from_own)
        together = _together(state, frames.carried_to(state, t_ns), carrier, planes)
        return Placed(own, own, None, None, picture_from_own, unsure, together)
    frame, joint = _frame(state, carrier, t_ns)
    if frame is None:
        return None
    between, _ = navigated(state, carrier, t_ns)
    unsure = _unsure(state, carrier, frame.covariance, joint)
    together = _together(state, joint, carrier, planes)
    other = site(between.other)
    return Placed(other, own, between.own_from_other, frame, picture_from_own, unsure, together)


def _together(
    state: State, joint: Frames | None, carrier: str, planes: tuple[Site, RigidTransform]
) -> Together | None:
    """The errors of all frames that are followed together, along the picture's axes.

    Args:
        carrier: who must be among them.
        planes: the own one, and its transform to the picture's.
    """
    if joint is None:
        return None
    own, picture_from_own = planes
    turn = np.eye(SIZE + 2)
    turn[:2, :2] = rotation_clockwise(yaw_rad(picture_from_own))
    members: dict[str, int] = {}
    rows, pivots = [], []
    for number, name in enumerate((state.own, *joint.carriers)):
        erring = len(_erring(state, name))
        if erring > 1 or (not number and not erring) or chosen.by_group(state, name):
            continue
        members[f"{name}/{state.carriers[name].boot}"] = SIZE + 2 * erring
        rows.append((WIDTH * number + LOGS)[: SIZE + 2 * erring])
        east, north = joint.mean[number, :2, None]
        there = on_surface(own, east, north, np.full(1, own.altitude_m))
        pivots.append(picture_from_own.apply(there)[0, :2])
    if f"{carrier}/{state.carriers[carrier].boot}" not in members:
        return None
    which = np.concatenate(rows)
    turned = block_diag(*(turn[:size, :size] for size in members.values()))
    covariance = turned @ joint.covariance[np.ix_(which, which)] @ turned.T
    return Together(tuple(members), tuple(members.values()), np.array(pivots), covariance)


def _erring(state: State, carrier: str) -> dict[str, RangeErrors]:
    """The sources of a carrier whose ranges err, by name."""
    errors = {s: chosen.range_errors(state, carrier, s) for s in sorted(state.sources(carrier))}
    return {source: ranges for source, ranges in errors.items() if not ranges.none}


def _unsure(state: State, carrier: str, frame: Array, joint: Frames | None) -> Unsure:
    """What is unsure of a carrier.

    Args:
        frame: (3, 3) covariance of (q, D).
        joint: whence it is, if it is from there.
    """
    errors = _erring(state, carrier)
    first = {source: SIZE + 2 * k for k, source in enumerate(errors)}
    covariance = block_diag(frame, *(ranges.covariance for ranges in errors.values()))
    if len(errors) == 1 and joint is not None and carrier in joint.carriers:
        covariance = frames.joint(joint).errors(frames.row(joint, carrier))
    return Unsure(covariance, {source: (row, errors[source]) for source, row in first.items()})


def _holds_unknown(state: State, carrier: str) -> bool:
    """Whether a carrier has a frame that nobody knows: what is known of a correction is out."""
    messages = state.carriers[carrier].navigation if carrier in state.carriers else ()
    return any(message.correction_id for message in messages[-1:])


def _frame(state: State, carrier: str, t_ns: int) -> tuple[OwnAxesFrame | None, Frames | None]:
    """An applied correction at an instant, and all frames if it is of those followed together."""
    counts, by_group = chosen.frame(state, carrier, t_ns)
    if counts:
        return by_group, None
    link = state.links.get(carrier)
    if link is None or link.monitor.state != "applied" or link.estimate is None:
        return None, None
    carried = frames.carried_to(state, t_ns)
    if carried is not None and carrier in carried.carriers:
        return frames.frame_of(carried, carrier), carried
    _, prior = navigated(state, carrier, t_ns)
    return corrections.at(link.estimate, prior), None
