"""Target logs of members, taken into the joint state with the targets they are of.

Which log is of which target is not decided here: a name that all can see says so, or else the
picture, which has put logs of several carriers to one track. A target of which only one member
speaks says nothing of the frames and does not join.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.frames import on_surface
from estimation.joint_navigation.members import Sighting, with_target
from estimation.joint_navigation.online import (
    improved,
    manoeuvred,
    moved_targets,
    velocity_mps,
    without,
)
from estimation.joint_navigation.online_rows import log_rows
from schemas.messages import SourceProperties, SourceReport

from ..navigation import NS, pose_at, site, way_m
from ..relative_frames.corrections import Misclosure
from ..sources.coordinates import Observer, Places, column, instants_ns
from ..sources.coordinates import places as located
from ..sources.news import NOTHING_TOLD, has_tracks, news
from ..state import Group, State
from .axes import CARRIER, SOURCE, TARGET, whereabouts
from .joining import joint_of, with_joint, with_source_of
from .ranging import moved

_MANOEUVRE = 13.8  # chi2 of 2 dof that one straight flight in a thousand exceeds
_CONFIRMED = 0.95
_LEAST_RANGE_M, _MOST_RANGE_M = 1.0, 1e7
_SIGMA_MPS = 300.0  # per axis, of a target of which there is one log


class _Log(NamedTuple):
    """A log of a known target: its block, place from the carrier, covariance, time after."""

    target: str
    seen_m: Array
    covariance: Array
    after_s: float


def with_report(
    state: State, group: Group, report: SourceReport
) -> tuple[Group, dict[str, Misclosure]]:
    """A group with the logs of one report; how they misclose, by carrier."""
    if left_out(report):
        return group, {}
    properties = state.sources(report.carrier).get(report.stream, SourceProperties())
    source = f"{SOURCE}{report.carrier}/{report.stream}"
    group, found = _located(state, group, report, properties)
    logs = list(_logs(state, group, report, found))
    if not logs:
        return group, {}
    group = moved(state, group, [report.carrier], report.t_ns)
    group = _of_late(state, with_source_of(group, source, properties), report.t_ns)
    carrier = CARRIER + report.carrier
    there = whereabouts(state, report.carrier, report.t_ns)
    speed = velocity_mps(joint_of(group), carrier, there.velocity_mps)
    sightings = [
        Sighting(log.target, carrier, source, log.seen_m, log.covariance, log.after_s, speed)
        for log in logs
    ]
    known = [s for s in sightings if s.target in group.targets]
    group, misclosure = _improved(state, group, known, report.t_ns)
    fresh = [s for s in sightings if s.target not in group.targets]
    return _with_new(state, group, fresh, report.t_ns), {report.carrier: misclosure}


def left_out(report: SourceReport) -> str:
    """Why none of the logs of a report tells of the joint state, in words; empty: they may."""
    return "bearings without ranges" if report.bearing_rad and not report.range_m else ""


def _improved(
    state: State, group: Group, logs: Sequence[Sighting], t_ns: int
) -> tuple[Group, Misclosure]:
    """A group with logs of targets that it knows; one that goes another way is let go so."""
    if not logs:
        return group, Misclosure(0, 0.0, 0)
    settings = state.settings.picture
    passed = {log.target: (t_ns - group.targets[log.target]) * NS for log in logs}
    joint = moved_targets(joint_of(group), passed, settings.quiet_m2ps3)
    for log in logs:
        rows = log_rows(joint, [log])(joint.mean)
        by = rows.by[:, joint.free]
        spread = by @ joint.covariance @ by.T + np.eye(2)
        if rows.residual @ np.linalg.solve(spread, rows.residual) > _MANOEUVRE:
            passed_s = abs(passed[log.target])
            joint = manoeuvred(joint, log.target, passed_s, settings.manoeuvring_m2ps3)
    taken = improved(joint, log_rows(joint, logs))
    chi2, dof = taken.misclosure(range(len(logs)))
    seen = {log.target: t_ns for log in logs}
    member = logs[0].carrier.partition("/")[2]
    count = replace(group.members[member], logs=group.members[member].logs + len(logs))
    members, targets = {**group.members, member: count}, {**group.targets, **seen}
    after = replace(with_joint(group, taken.joint), members=members, targets=targets)
    return after, Misclosure(dof // 2, chi2, dof)


def _with_new(state: State, group: Group, logs: Sequence[Sighting], t_ns: int) -> Group:
    """A group with the targets of these logs, as long as there is room."""
    joint, targets = joint_of(group), dict(group.targets)
    room = state.settings.alignment.most_targets - len(targets)
    for log in logs[: max(room, 0)]:
        joint = with_target(joint, log, _SIGMA_MPS)
        targets[log.target] = t_ns
    return replace(with_joint(group, joint), targets=targets)


def _of_late(state: State, group: Group, t_ns: int) -> Group:
    """A group without the targets that have not been seen for long."""
    memory_s = state.settings.alignment.target_memory_s
    gone = [name for name, seen in group.targets.items() if (t_ns - seen) * NS > memory_s]
    targets = {name: seen for name, seen in group.targets.items() if name not in gone}
    return replace(with_joint(group, without(joint_of(group), gone)), targets=targets)


def _located(
    state: State, group: Group, report: SourceReport, properties: SourceProperties
) -> tuple[Group, Places]:
    """Where the logs of a report put their targets; of tracks, what is new in them.

    The group remembers for itself what tracks have said: it may hear a source that others do not.
    """
    messages = state.carriers[report.carrier].navigation
    at_ns = instants_ns(report)
    ways = way_m(messages, at_ns)
    here = site(pose_at(messages, report.t_ns))
    observer = Observer(here, ways - way_m(messages, report.t_ns))
    found = located(report, properties, observer, state.settings.logs.target_altitude_m)
    if not has_tracks(report, properties):
        return group, found
    source = f"{SOURCE}{report.carrier}/{report.stream}"
    before = group.told.get(source, NOTHING_TOLD)
    found, told = news(before, report, properties, found, ways)
    return replace(group, told={**group.told, source: told}), found


def _logs(state: State, group: Group, report: SourceReport, found: Places) -> Iterator[_Log]:
    """The logs of a report that are of known targets, along the axes of the scenario."""
    named = _names(state, group, report)
    once = Counter(name for name in named if name)
    which = [i for i, name in enumerate(named) if name and once[name] == 1 and found.usable[i]]
    if not which:
        return
    here = site(pose_at(state.carriers[report.carrier].navigation, report.t_ns))
    axes = whereabouts(state, report.carrier, report.t_ns).axes
    east, north = found.east_north_m.T
    seen = on_surface(here, east, north, found.altitude_m) @ axes.rotation[:2].T
    turn = axes.rotation[:2, :2]
    jitter = np.nan_to_num(column(report.sigma_time_offset_s, len(report)))
    blur = (state.settings.logs.sigma_velocity_mps * jitter) ** 2
    covariance = turn @ found.covariance @ turn.T + blur[:, None, None] * np.eye(2)
    after_s = (instants_ns(report) - report.t_ns) * NS
    for i in which:
        definite = np.linalg.det(covariance[i]) > 0
        far = float(np.hypot(*seen[i]))
        young = abs(after_s[i]) <= state.settings.logs.max_age_s
        if definite and young and _LEAST_RANGE_M < far < _MOST_RANGE_M:
            yield _Log(TARGET + named[i], seen[i], covariance[i], float(after_s[i]))


def _names(state: State, group: Group, report: SourceReport) -> list[str]:
    """What the target of each log is called, where another member speaks of it too; else empty."""
    n = len(report)
    identities, kinds = report.identity or [None] * n, report.identity_kind or [None] * n
    told = [f"{k or ''}/{i}" if i else "" for i, k in zip(identities, kinds, strict=True)]
    others = set(group.members) - {report.carrier}
    shared = {
        identity
        for name in others
        for logs in state.carriers[name].logs.values()
        for identity in logs.identity
        if identity
    }
    pictured = _pictured(state, others, report) if not all(told) else {}
    return [
        name if name in shared else pictured.get(i, "") if not name else ""
        for i, name in enumerate(told)
    ]


def _pictured(state: State, others: set[str], report: SourceReport) -> dict[int, str]:
    """Names of targets by number of the log: the picture's tracks that other members see too."""
    picture = state.picture.picture
    if picture is None:
        return {}
    boot = state.carriers[report.carrier].boot
    source = f"{report.carrier}/{report.stream}"
    mine = f"{report.carrier}/{boot}/{report.stream}/{report.seq}/"
    existence = dict(
        zip(picture.tracks.identity.tolist(), picture.tracks.existence.tolist(), strict=True)
    )
    names = {}
    for number, notes in state.picture.notes.items():
        log = notes.logs.get(source, "")
        seen_by = {other.partition("/")[0] for other in notes.logs}
        sure = existence.get(int(number), 0.0) > _CONFIRMED
        if log.startswith(mine) and seen_by & others and sure:
            names[int(log[len(mine) :])] = notes.identity or f"#{number}"
    return names
