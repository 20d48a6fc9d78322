"""One simulated carrier as a pure step: the truth in, its messages out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct

from estimation.arrays import Array
from estimation.frames import Site, geodetic_from_enu, on_surface, site_at
from schemas import keys
from schemas.errors import ScenarioError
from schemas.feedback import applied, corrected
from schemas.messages import (
    Correction,
    Navigation,
    Pose,
    Ranging,
    SourceInfo,
    SourceReport,
    StreamEnd,
    TruthCarriers,
    TruthTargets,
)
from sim_world.clocks import stamp_ns
from sim_world.logs import Logs
from sim_world.navigation import declared_covariances, sail
from sim_world.ranging import Measured, RangingDevice
from sim_world.scenario import Scenario
from sim_world.scenario.declared import origin_of
from sim_world.scene import Stand, stand_of, targets_of
from sim_world.schedule import Look
from sim_world.sensors import Sensor
from sim_world.tracking_radar import Observation, RadarTracker

from .reports import plot_columns, track_columns

LIGHT_MPS = 299_792_458.0
_UPPER = np.triu_indices(3)


class Outgoing(NamedTuple):
    """A message and where it goes: `topic.key(run, *ids)`."""

    topic: keys.Topic
    ids: tuple[str, ...]
    message: Struct


class Stamp:
    """One life of a carrier: its boot, how far its streams have come, where its way began, tracks.

    It is all that is remembered from step to step, and since when the carrier errs as it does; a
    new one is a new boot.
    """

    def __init__(self, boot: str) -> None:
        self.boot = boot
        self._first_step: int | None = None
        self._since_ns = 0
        self._last_seq: dict[str, int] = {}
        self._trackers: dict[str, RadarTracker] = {}

    def begins(self, step: int) -> bool:
        """Whether this is the first step of this life."""
        self._first_step = step if self._first_step is None else self._first_step
        return step == self._first_step

    def first_step(self) -> int:
        """Where reckoning began; 0 before the first step."""
        return self._first_step or 0

    def errs_since_ns(self, navigation: Navigation) -> int:
        """Since when its error is the one of now: it is another after a fix, and in a new life."""
        if navigation.kind == "fix" or not self._since_ns:
            self._since_ns = navigation.t_ns
        return self._since_ns

    def next_seq(self, stream: str) -> int:
        """The seq of the next message of a stream, from 1."""
        self._last_seq[stream] = self._last_seq.get(stream, 0) + 1
        return self._last_seq[stream]

    def tracker(self, sensor: Sensor) -> RadarTracker | None:
        """The tracks of a sensor that tracks; they begin with this life."""
        tracking = sensor.table.tracking
        if tracking and sensor.name not in self._trackers:
            self._trackers[sensor.name] = RadarTracker(
                sensor.plots, tracking.process_noise, tracking.sigma_velocity_mps
            )
        return self._trackers.get(sensor.name)

    def manifest(self, carrier: str) -> list[StreamEnd]:
        """How far every stream has come."""
        return [
            StreamEnd(carrier=carrier, boot=self.boot, stream=stream, last_seq=last)
            for stream, last in sorted(self._last_seq.items())
        ]


class _Now(NamedTuple):
    """One step as a carrier lives it."""

    step: int
    t_ns: int
    stand: Stand
    stamp: Stamp


class Carrier:
    """A carrier of a scenario; what it says depends on the truth of a step and on its stamp.

    Raises:
        ScenarioError: it has no carrier of that name.
    """

    def __init__(self, scenario: Scenario, name: str) -> None:
        file = scenario.file
        part = {c.name: c for c in file.carriers}.get(name)
        if part is None:
            names = ", ".join(c.name for c in file.carriers)
            raise ScenarioError(
                "no such carrier", where=file.name, got=name, expected=f"one of {names}"
            )
        self.name = name
        self._part, self._origin = part, origin_of(file)
        self._step_s = file.time.step_s
        self._voyage = sail(file, part, self._origin, scenario.declared.steps)
        self._covariance = declared_covariances(part.navigation, self._voyage, file.time.step_s)
        self._sensors = [Sensor(file, name, sensor) for sensor in part.sensors]
        self._ranging = [RangingDevice(file, name, table) for table in part.ranging]

    @property
    def uses_corrections(self) -> bool:
        """Whether the scenario tells it to."""
        return self._part.use_corrections

    def step(
        self,
        targets: TruthTargets,
        carriers: TruthCarriers,
        stamp: Stamp,
        correction: Correction | None = None,
    ) -> Iterator[Outgoing]:
        """Everything the carrier says at one step: sources once, navigation, ranges, reports due.

        Args:
            correction: to apply if it may be; all is said in the frame so corrected.

        Raises:
            ValueError: targets and carriers are of different steps, or this one is not in them.
        """
        if targets.step != carriers.step:
            raise ValueError(f"need one step, got targets {targets.step}, carriers {carriers.step}")
        stand = stand_of(carriers, self.name, self._origin)
        now = _Now(targets.step, targets.t_ns, stand, stamp)
        if stamp.begins(now.step):
            yield from self._sources(now)
        navigation = self._navigation(now)
        since_ns = stamp.errs_since_ns(navigation)
        held = applied(correction, navigation, since_ns)
        yield Outgoing(keys.NAVIGATION, (self.name,), corrected(navigation, held))
        for device in self._ranging:
            for look in device.due(now.step):
                for measured in device.measure(look, now.step, carriers):
                    message = self._range(device, look, measured, now)
                    yield Outgoing(keys.RANGING, (self.name,), message)
        scene = targets_of(targets)
        for sensor in self._sensors:
            for look in sensor.due(now.step):
                report = self._report(sensor, look, sensor.observe(look, stand, scene), now)
                yield Outgoing(keys.REPORT, (self.name, sensor.name), corrected(report, held))

    def _sources(self, now: _Now) -> Iterator[Outgoing]:
        for sensor in self._sensors:
            info = SourceInfo(
                **self._envelope("info", now, now.t_ns),
                source=sensor.name,
                properties=sensor.declared,
            )
            yield Outgoing(keys.SOURCE, (self.name, sensor.name), info)

    def _navigation(self, now: _Now) -> Navigation:
        k, voyage, prior = now.step, self._voyage, self._part.navigation
        way = voyage.way_m[k] - voyage.way_m[now.stamp.first_step()]
        sigma_speed = float(np.hypot(prior.sigma_speed_mps, prior.sigma_current_mps))
        return Navigation(
            **self._envelope("navigation", now, now.t_ns),
            pose=self._pose(now),
            kind="fix" if voyage.fixed[k] else "dead_reckoning",
            correlation_time_s=prior.fix.period_s if prior.fix else 0.0,
            reckoned_east_m=float(way[0]),
            reckoned_north_m=float(way[1]),
            speed_mps=float(voyage.log_mps[k]),
            sigma_speed_mps=sigma_speed or None,
            sigma_heading_rad=float(np.sqrt(self._covariance[k, 2, 2])),
        )

    def _pose(self, now: _Now) -> Pose:
        """Where it believes it is: the true place moved by the error it has gathered."""
        true = site_at(self._origin, now.stand.motion.position_m)
        latitude, longitude = _moved(true, self._voyage.position_error_m[now.step])
        return Pose(
            latitude_rad=latitude,
            longitude_rad=longitude,
            altitude_m=true.altitude_m,
            heading_rad=float(self._voyage.compass_rad[now.step]),
            covariance=self._covariance[now.step][_UPPER].tolist(),
        )

    def _report(self, sensor: Sensor, look: Look, logs: Logs, now: _Now) -> SourceReport:
        measured_ns = now.t_ns + look.after_step_ns
        envelope = self._envelope(sensor.name, now, measured_ns, sensor.errors.clock_s)
        tracker = now.stamp.tracker(sensor)
        if tracker is None:
            return SourceReport(**envelope, **plot_columns(sensor, logs))
        seen_from = Observation(envelope["t_ns"], self._way_m(look, now), self._site(now))
        tracks = tracker.update(logs, seen_from)
        return SourceReport(**envelope, **track_columns(sensor, logs, tracks))

    def _way_m(self, look: Look, now: _Now) -> Array:
        """What has been reckoned by the time of a look, between the step before and this one."""
        way, k = self._voyage.way_m, now.step
        share = look.after_step_ns * 1e-9 / self._step_s
        reckoned = way[k] + share * (way[k] - way[max(k - 1, 0)])
        since: Array = reckoned - way[now.stamp.first_step()]
        return since

    def _site(self, now: _Now) -> Site:
        pose = self._pose(now)
        return Site(pose.latitude_rad, pose.longitude_rad, pose.altitude_m)

    def _range(self, device: RangingDevice, look: Look, measured: Measured, now: _Now) -> Ranging:
        """A range at the instant it was taken; light is on its way there and back, or once."""
        kind = device.table.kind
        envelope = self._envelope("ranging", now, now.t_ns + look.after_step_ns)
        received_ns = envelope["t_ns"]
        light_s = measured.value_m / LIGHT_MPS * (2 if kind == "two_way" else 1)
        sent_ns = max(received_ns - round(light_s * 1e9), 0)
        return Ranging(
            **envelope,
            peer=measured.peer,
            kind=kind,
            value_m=measured.value_m,
            sigma_m=measured.sigma_m,
            reference=measured.reference or None,
            t_tx_ns=0 if measured.reference else sent_ns,
            t_rx_ns=0 if measured.reference else received_ns,
        )

    def _envelope(
        self, stream: str, now: _Now, true_ns: int, clock_s: float = 0.0
    ) -> dict[str, Any]:
        """The fields that every input begins with; `clock_s` is what a sensor's clock adds."""
        return {
            "carrier": self.name,
            "boot": now.stamp.boot,
            "stream": stream,
            "seq": now.stamp.next_seq(stream),
            "step": now.step,
            "t_ns": stamp_ns(true_ns, now.stand.clock_offset_s, clock_s),
        }


def _moved(site: Site, east_north_m: Array) -> tuple[float, float]:
    """Latitude and longitude of the point this far east and north of a site, on its level."""
    if not east_north_m.any():
        return site.latitude_rad, site.longitude_rad
    point = on_surface(site, east_north_m[0], east_north_m[1], site.altitude_m)
    latitude, longitude, _ = geodetic_from_enu(site, point)
    return float(latitude), float(longitude)
