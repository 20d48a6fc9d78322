"""Beacons and ranges: each carrier that ranges to declared beacons, and they, aligned as it moves.

Paper 003 over time: an extended Kalman filter of the carrier's place and of constants (current,
speed scale, north, range scale, bias and clock, the beacons' places), predicted by the way of every
Navigation and updated by every Ranging to a beacon. Axes are those of the scenario's origin, in
which the beacons are declared; what the carrier states of its frame is the prior of its place and
north.

Position fixes after the first message, and ranges between carriers, are not used.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.frames import (
    RigidTransform,
    Site,
    enu_from_geodetic,
    polar_from_east_north,
    target_from_source,
)
from estimation.system_alignment import (
    DeadReckoning,
    Prior,
    Ranges,
    dead_reckoning,
    predicted,
    prior,
    ranges,
    second_order,
    started,
    updated,
)
from estimation.system_alignment.parameters import HEADING_BIAS
from schemas.messages import (
    DeclaredBeacon,
    DeclaredCarrier,
    DeclaredRanging,
    Input,
    Navigation,
    Ranging,
)

from .. import timeline
from ..navigation import NS, frame_covariance, pose_at, site, way_m
from ..state import Aligned, State
from .published import diagnosed, filter_of

_NORTH_KNOWN_RAD = 1e-6  # below, a stated sigma is but the floor that keeps a matrix invertible
_SLOW_MPS = 1.0
_MOST_SPEED_SCALE = 0.5
_LEAST_SIGMA_M = 1e-3


class _Member(NamedTuple):
    """A carrier that ranges to beacons, as declared."""

    carrier: DeclaredCarrier
    devices: list[DeclaredRanging]
    beacons: list[DeclaredBeacon]


def is_wanted(state: State) -> bool:
    """Whether there is anything to align in this run."""
    return state.settings.alignment.enabled and bool(state.scenario.beacons)


def with_ranges(state: State, instant: timeline.Instant) -> State:
    """The state after what carriers said at one instant of their way and of beacons."""
    if not is_wanted(state):
        return state
    said: dict[str, list[Input]] = {}
    for message in instant.messages:
        if isinstance(message, Navigation | Ranging) and _is_of_this_life(state, message):
            said.setdefault(message.carrier, []).append(message)
    for carrier, messages in said.items():
        member = _member(state, carrier)
        if member is not None:
            with np.errstate(all="ignore"):  # numbers from the wire may be anything in bounds
                state = _with_messages(state, member, instant.t_ns, messages)
    return state


def _origin(state: State) -> Site:
    """Of the axes in which everything here lies."""
    there = state.scenario.origin
    return Site(there.latitude_rad, there.longitude_rad, there.altitude_m)


def _is_of_this_life(state: State, message: Input) -> bool:
    carrier = state.carriers.get(message.carrier)
    boot = timeline.ordinal(state.timeline, message.carrier, message.boot)
    return carrier is not None and carrier.boot == boot and bool(carrier.navigation)


def _member(state: State, name: str) -> _Member | None:
    """A declared carrier and what it ranges to; None if that is no beacon.

    Of two-way ranges and pseudoranges only the first are used, for one bias stands for both.
    """
    carrier = state.declared(name)
    if carrier is None:
        return None
    declared = {beacon.name for beacon in state.scenario.beacons}
    devices = [device for device in carrier.ranging if declared & set(device.to)]
    if any(device.kind == "two_way" for device in devices):
        devices = [device for device in devices if device.kind != "pseudorange"]
    heard = {peer for device in devices for peer in device.to}
    beacons = [beacon for beacon in state.scenario.beacons if beacon.name in heard]
    if not beacons:
        return None
    return _Member(carrier, devices, beacons[: state.settings.alignment.most_beacons])


def _with_messages(state: State, member: _Member, t_ns: int, messages: Sequence[Input]) -> State:
    name = member.carrier.name
    known, carrier = state.aligned.get(name), state.carriers[name]
    if known is None or known.boot != carrier.boot:
        known = _begun(state, member, t_ns)
        if known is None:
            return state
    age_s = (t_ns - carrier.navigation[-1].t_ns) * NS
    if t_ns >= known.t_ns and age_s <= state.settings.navigation.max_age_s:
        after = _updated(state, member, _moved(state, member, known, t_ns), messages)
        if np.isfinite(after.covariance).all() and np.isfinite(after.theta).all():
            known = after
    return replace(state, aligned={**state.aligned, name: known})


def _begun(state: State, member: _Member, t_ns: int) -> Aligned | None:
    """The filter at the first message of a life; None while nothing is said of its errors."""
    carrier = state.carriers[member.carrier.name]
    stated = frame_covariance(pose_at(carrier.navigation, t_ns), member.carrier)
    if stated is None:
        return None
    before = _prior(state, member, float(np.sqrt(stated[2, 2])), carrier.navigation[-1].speed_mps)
    place_m = _axes(state, member, t_ns).translation_m[:2]
    first = started(_step(state, member, 1.0, np.zeros(2), place_m), before)
    covariance = first.covariance.copy()
    covariance[:2, :2] = stated[:2, :2]
    b = len(first.place)
    for at in b + np.flatnonzero(first.free == HEADING_BIAS):
        covariance[:2, at] = covariance[at, :2] = -stated[:2, 2]  # true less reported place
    return Aligned(
        boot=carrier.boot,
        beacons=tuple(beacon.name for beacon in member.beacons),
        start_t_ns=t_ns,
        t_ns=t_ns,
        start_m=place_m,
        way_m=way_m(carrier.navigation, t_ns),
        place=first.place,
        theta=first.theta,
        covariance=covariance,
        free=first.free.astype(np.int64),
        prior_mean=before.mean,
        prior_sigma=np.sqrt(np.diag(before.covariance)),
    )


def _prior(state: State, member: _Member, sigma_north_rad: float, speed_mps: float) -> Prior:
    """Of the constants, as declared; a wrong log is taken for a scale at the first speed."""
    beacons, devices, carrier = member.beacons, member.devices, member.carrier
    places = enu_from_geodetic(
        _origin(state),
        [beacon.latitude_rad for beacon in beacons],
        [beacon.longitude_rad for beacon in beacons],
        [beacon.altitude_m for beacon in beacons],
    )
    sigmas = [[b.sigma_position_m, b.sigma_position_m, b.sigma_altitude_m] for b in beacons]
    plain = [device for device in devices if device.kind != "difference"]
    clocks = [device for device in plain if device.kind == "pseudorange"]
    scale = carrier.sigma_speed_mps / max(abs(speed_mps), _SLOW_MPS)
    bias_m = max((device.sigma_range_bias_m for device in plain), default=0.0)
    clock_m = max((device.sigma_clock_m for device in clocks), default=0.0)
    return prior(
        places,
        sigmas,
        sigma_wind_mps=carrier.sigma_current_mps,
        sigma_speed_scale=min(scale, _MOST_SPEED_SCALE),
        sigma_heading_bias_rad=sigma_north_rad if sigma_north_rad > _NORTH_KNOWN_RAD else 0.0,
        sigma_range_scale=max(device.sigma_range_scale for device in devices),
        sigma_clock_offset_m=float(np.hypot(bias_m, clock_m)),
        sigma_clock_drift_mps=max((device.sigma_clock_drift_mps for device in clocks), default=0.0),
    )


def _axes(state: State, member: _Member, t_ns: int) -> RigidTransform:
    """From the carrier's east-north-up, as reported at an instant, to the scenario's."""
    messages = state.carriers[member.carrier.name].navigation
    return target_from_source(_origin(state), site(pose_at(messages, t_ns)))


def _step(
    state: State, member: _Member, passed_s: float, travel_m: Array, start_m: Array
) -> DeadReckoning:
    """One step of dead reckoning; readings, a step of the scenario apart, err independently."""
    carrier = member.carrier
    bearing, length = polar_from_east_north(travel_m)
    readings = np.sqrt(state.scenario.step_ns * NS / passed_s)
    return dead_reckoning(
        [passed_s],
        length / passed_s,
        bearing,
        carrier.sigma_log_noise_mps * readings,
        carrier.sigma_compass_noise_rad * readings,
        sigma_turn_rad=carrier.sigma_north_drift_rad_per_sqrt_s * np.sqrt(passed_s),
        start_m=start_m,
    )


def _moved(state: State, member: _Member, known: Aligned, t_ns: int) -> Aligned:
    """Carried on to an instant by the way reckoned since."""
    if t_ns == known.t_ns:
        return known
    way = way_m(state.carriers[member.carrier.name].navigation, t_ns)
    axes = _axes(state, member, t_ns)
    passed_s = (t_ns - known.t_ns) * NS
    travel = axes.rotation[:2, :2] @ (way - known.way_m)
    now = predicted(filter_of(known), _step(state, member, passed_s, travel, known.start_m), 0)
    return replace(known, t_ns=t_ns, way_m=way, place=now.place, covariance=now.covariance)


def _updated(state: State, member: _Member, known: Aligned, messages: Sequence[Input]) -> Aligned:
    """With the ranges to beacons among the messages of its instant."""
    kinds = {device.kind for device in member.devices}
    heard = [m for m in messages if isinstance(m, Ranging) and m.kind in kinds]
    logs = _ranges(list(_rows(known, heard)))
    if len(logs.value_m) == 0:
        return known
    height_m = float(_axes(state, member, known.t_ns).translation_m[2])
    before = filter_of(known)
    now = updated(before, second_order(before, logs, height_m), height_m)
    count = known.ranges + len(logs.value_m)
    known = replace(
        known, place=now.place, theta=now.theta, covariance=now.covariance, ranges=count
    )
    every_ns = round(state.settings.alignment.diagnose_every_s * 1e9)
    if known.diagnosed_t_ns >= 0 and known.t_ns < known.diagnosed_t_ns + every_ns:
        return known
    return diagnosed(known, height_m)


def _rows(known: Aligned, heard: Sequence[Ranging]) -> Iterator[tuple[int, float, float, int]]:
    """Beacon, value, sigma and reference of each range to a beacon."""
    number = {name: i for i, name in enumerate(known.beacons)}
    for message in heard:
        differs = message.kind == "difference"
        reference = number.get(message.reference or "") if differs else -1
        if message.peer in number and reference is not None:
            sigma = max(message.sigma_m, _LEAST_SIGMA_M)
            yield number[message.peer], message.value_m, sigma, reference


def _ranges(rows: Sequence[tuple[int, float, float, int]]) -> Ranges:
    beacon, value, sigma, reference = np.array(rows, dtype=float).reshape(-1, 4).T
    return ranges(np.zeros(len(beacon)), beacon, value, sigma, reference)
