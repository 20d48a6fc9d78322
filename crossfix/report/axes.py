"""The picture's axes: east and north at the scenario's origin, as the own carrier believes them.

The own carrier's reported place and its own north are the gauge. What another carrier reports
stands where its own navigation puts it; the truth is shown as the own carrier would see it without
noise, so that after a perfect correction everything coincides.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

from crossfix.evaluation.frames import sensor_norths_rad
from crossfix.own_frames import as_own
from estimation.arrays import Array
from estimation.frames import (
    RigidTransform,
    Site,
    on_surface,
    rotation_clockwise,
    site_at,
    target_from_source,
)
from fusion_center.navigation import pose_at, site
from schemas.messages import Navigation, Pose, TruthCarriers

from .story import Story


class View(NamedTuple):
    """A carrier's reported place at one instant."""

    site: Site
    picture_from_carrier: RigidTransform

    def placed(self, east_north_m: Array, altitude_m: float | Array = 0.0) -> Array:
        """Points (n, 2) [m] along the carrier's axes, in the picture's axes (n, 2)."""
        east, north = east_north_m.T
        enu = on_surface(self.site, east, north, altitude_m)
        return self.picture_from_carrier.apply(enu)[:, :2]


class TruthView(NamedTuple):
    """The own carrier's true place and north at one instant, beside what it believes."""

    own_from_origin: RigidTransform
    north_error_rad: float
    believed: View

    def placed(self, enu_m: Array) -> Array:
        """True points (n, 3) [m] of the scenario's axes, in the picture's axes (n, 2)."""
        seen = self.own_from_origin.apply(enu_m)
        seen[:, :2] = seen[:, :2] @ rotation_clockwise(-self.north_error_rad).T
        return self.believed.picture_from_carrier.apply(seen)[:, :2]


def truth_seen_by(own: str, truth: TruthCarriers, origin: Site, believed: View) -> TruthView:
    """How the truth is seen by a carrier of it, by its own sensors, as the picture is judged."""
    index = truth.carrier.index(own)
    north_error = sensor_norths_rad(truth)[index] if truth.north_error_rad else 0.0
    own_site = site_at(origin, truth.position_m[index])
    return TruthView(target_from_source(own_site, origin), north_error, believed)


class Axes:
    """Takes what a story tells into the picture's axes."""

    def __init__(self, story: Story) -> None:
        self._story = story
        fields = story.scenario.origin
        self.origin = Site(fields.latitude_rad, fields.longitude_rad, fields.altitude_m)
        self._navigation = {
            name: sorted(messages, key=_time) for name, messages in story.navigation.items()
        }
        self._truth_views: dict[int, TruthView | None] = {}

    @cached_property
    def uncorrected(self) -> Axes:
        """The same by what carriers would say without the corrections they apply."""
        own = {
            name: [as_own(message) for message in messages]
            for name, messages in self._story.navigation.items()
        }
        return Axes(self._story._replace(navigation=own))

    def navigation(self, carrier: str, t_ns: int) -> Sequence[Navigation]:
        """The last one or two messages of one boot up to an instant; none before the first."""
        messages = self._navigation.get(carrier, [])
        end = bisect_right(messages, t_ns, key=_time)
        last_two = messages[max(0, end - 2) : end]
        if len(last_two) == 2 and not _give_velocity(*last_two):
            return last_two[1:]
        return last_two

    def pose(self, carrier: str, t_ns: int) -> Pose | None:
        """Reported pose, carried on from the last message; None before the first."""
        messages = self.navigation(carrier, t_ns)
        return pose_at(messages, t_ns) if messages else None

    def view(self, carrier: str, t_ns: int) -> View | None:
        """Where a carrier believes it is; None before its first navigation."""
        pose = self.pose(carrier, t_ns)
        return self.view_of(pose) if pose else None

    def view_of(self, pose: Pose) -> View:
        """From a reported pose."""
        return View(site(pose), target_from_source(self.origin, site(pose)))

    def truth_view(self, truth: TruthCarriers) -> TruthView | None:
        """How truth of one step is seen; None where the own carrier is not there yet."""
        if truth.step not in self._truth_views:
            self._truth_views[truth.step] = self._truth_view(truth)
        return self._truth_views[truth.step]

    def _truth_view(self, truth: TruthCarriers) -> TruthView | None:
        believed = self.view(self._story.own, truth.t_ns)
        if believed is None or self._story.own not in truth.carrier:
            return None
        return truth_seen_by(self._story.own, truth, self.origin, believed)


def _time(message: Navigation) -> int:
    return message.t_ns


def _give_velocity(before: Navigation, newest: Navigation) -> bool:
    """Whether the way between two messages tells a velocity: one boot, two instants."""
    return before.boot == newest.boot and before.t_ns < newest.t_ns
