"""What has been said up to a moment: who believes to be where, what sources are, what is true."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from crossfix.evaluation import symmetric
from crossfix.evaluation.recordings import own_carrier
from crossfix.report.axes import TruthView, View, truth_seen_by
from crossfix.report.logs import log_names
from estimation.arrays import Array
from estimation.frames import (
    RigidTransform,
    Site,
    east_north_from_polar,
    rotation_clockwise,
    site_at,
    target_from_source,
    yaw_rad,
)
from fusion_center.navigation import pose_at, site, way_m
from fusion_center.sources.coordinates import Flags, Observer, instants_ns, places
from schemas import messages as m

UNKNOWN_RANGE_M = 50e3
"""How far a bearing is drawn that has no range, if its source states no limit."""


class Seen(NamedTuple):
    """The n logs of a report along the axes its carrier believes in.

    Attributes:
        east_north_m: (n, 2), covariance: (n, 2, 2) [m^2]; nan where a log has no range.
        ray_m: (n, 2) where a log without one points to; nan for the others.
    """

    names: list[str]
    east_north_m: Array
    covariance: Array
    ray_m: Array


class Situation:
    """Hears messages in their order; knows the newest of each kind."""

    def __init__(self, scenario: m.DeclaredScenario) -> None:
        self.own = own_carrier(scenario)
        self.origin = Site(
            scenario.origin.latitude_rad,
            scenario.origin.longitude_rad,
            scenario.origin.altitude_m,
        )
        self._numbers = {carrier.name: n for n, carrier in enumerate(scenario.carriers)}
        self._navigation: dict[str, tuple[m.Navigation, ...]] = {}
        self._sources = {
            (carrier.name, name): properties
            for carrier in scenario.carriers
            for name, properties in carrier.sources.items()
        }
        self.truth: m.TruthCarriers | None = None

    def hear(self, message: object) -> None:
        """Take a message in."""
        if isinstance(message, m.Navigation):
            before = self._navigation.get(message.carrier, ())
            kept = [n for n in before[-1:] if n.boot == message.boot and n.t_ns < message.t_ns]
            self._navigation[message.carrier] = (*kept, message)
        elif isinstance(message, m.SourceInfo):
            self._sources[message.carrier, message.source] = message.properties
        elif isinstance(message, m.TruthCarriers):
            self.truth = message

    def number(self, carrier: str) -> int:
        """Of a carrier, in order of declaration and then of appearance."""
        return self._numbers.setdefault(carrier, len(self._numbers))

    def sources(self) -> list[tuple[str, str]]:
        """Carrier and id of every source that is known."""
        return list(self._sources)

    def properties(self, carrier: str, source: str) -> m.SourceProperties:
        """What a source has declared of itself, or the defaults."""
        return self._sources.get((carrier, source), m.SourceProperties())

    def view(self, carrier: str, t_ns: int) -> View | None:
        """Where a carrier believes it is; None before its first navigation."""
        said = self._navigation.get(carrier)
        return self.view_of(pose_at(said, t_ns)) if said else None

    def view_of(self, pose: m.Pose) -> View:
        """From a reported pose."""
        return View(site(pose), target_from_source(self.origin, site(pose)))

    def seen(self, report: m.SourceReport) -> Seen | None:
        """The logs of a report; None before its carrier has said where it is."""
        said = self._navigation.get(report.carrier)
        if not said or not len(report):
            return None
        properties = self.properties(report.carrier, report.stream)
        way = way_m(said, instants_ns(report)) - way_m(said, report.t_ns)
        observer = Observer(site(pose_at(said, report.t_ns)), way)
        found = places(report, properties, observer, 0.0)
        return Seen(
            log_names(report),
            found.east_north_m + way,
            found.covariance,
            _rays(report, properties, found.located) + way,
        )

    def truth_view(self) -> TruthView | None:
        """How the newest truth is seen by the own carrier; None where that is not known."""
        truth = self.truth
        believed = self.view(self.own, truth.t_ns) if truth else None
        if truth is None or believed is None or self.own not in truth.carrier:
            return None
        return truth_seen_by(self.own, truth, self.origin, believed)


class Corrected(NamedTuple):
    """A correction that is in force.

    Attributes:
        own_from_other: the other carrier's frame in own axes.
        place: where that puts the other carrier; covariance: (2, 2) in own axes [m^2].
    """

    own_from_other: RigidTransform
    own: View
    place: Site
    covariance: Array


def corrected(situation: Situation, correction: m.Correction) -> Corrected | None:
    """What a correction says, if it is applied."""
    axes, own_pose, other_pose = correction.own_axes, correction.own_pose, correction.other_pose
    if correction.state != "applied" or not (axes and own_pose and other_pose):
        return None
    own = situation.view_of(own_pose)
    known = target_from_source(own.site, site(other_pose))
    rotation = np.eye(3)
    rotation[:2, :2] = rotation_clockwise(axes.rotation_rad + yaw_rad(known))
    translation = np.array([axes.east_m, axes.north_m, known.translation_m[2]])
    return Corrected(
        RigidTransform(rotation, translation),
        own,
        site_at(own.site, translation),
        symmetric(axes.covariance)[:2, :2],
    )


def _rays(report: m.SourceReport, properties: m.SourceProperties, located: Flags) -> Array:
    """Ends (n, 2) of the bearings of logs that have no place."""
    n = len(report)
    if report.bearing_rad is None:
        return np.full((n, 2), np.nan)
    bearing = np.array([np.nan if b is None else b for b in report.bearing_rad], dtype=float)
    reach = properties.range_max_m if properties.range_max_m < 1e6 else UNKNOWN_RANGE_M
    return np.where(located[:, None], np.nan, east_north_from_polar(bearing, reach))
