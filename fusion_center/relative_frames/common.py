"""Targets that carriers have in common: each carrier's tracks against all before it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from estimation.arrays import Array, transposed
from estimation.frames import rotation_clockwise
from estimation.relative_frame import NetworkLogs, OwnAxesFrame, PolarLogs

from ..sources.sightings import Method, Sightings
from ..sources.telling import NOTHING_TELLS, Telling
from ..state import Orders
from .association import associate
from .views import View


class Member(NamedTuple):
    """One track: the number of its carrier, 0 the own one, its row there, and how it was paired.

    Attributes:
        by_place, by_features: as of a `Pair`.
    """

    carrier: int
    row: int
    method: Method
    by_place: float = 0.0
    by_features: float = 0.0


Target = tuple[Member, ...]
"""Tracks taken for one target, the first of them the leading one."""


def common_targets(
    views: Sequence[View],
    frames: Sequence[OwnAxesFrame],
    orders: Orders,
    gate: float,
    telling: Telling = NOTHING_TELLS,
) -> list[Target]:
    """Targets that two or more carriers see.

    Args:
        views: of the own carrier and of those that are followed, along the axes of the own plane.
        frames: of the latter.
        gate: chi2 of 2 dof within which coordinates may pair.
        telling: how features tell targets apart.
    """
    table = _plain(views[0])
    members: list[list[Member]] = [[Member(0, row, "coordinates")] for row in range(len(table.log))]
    for number, (view, frame) in enumerate(zip(views[1:], frames, strict=True), 1):
        pairs = associate(table, view, orders, frame, gate, telling)
        for pair in pairs:
            members[pair.own].append(Member(number, pair.other, pair.method, *pair[3:]))
        paired = {pair.other for pair in pairs}
        alone = np.array([i for i in range(len(view.log)) if i not in paired], dtype=np.intp)
        if number < len(frames) and alone.size:
            table = _joined(table, in_own_axes(view.take(alone), frame))
            members += [[Member(number, int(row), "coordinates")] for row in alone]
    return [tuple(target) for target in members if len(target) > 1]


def in_own_axes(view: View, frame: OwnAxesFrame) -> Sightings:
    """Tracks of another carrier at their places in own axes, with what the frame leaves unsure.

    The covariance is S + H P H': a correction is applied with all its doubt, see `consider`.
    """
    turn = rotation_clockwise(frame.D_rad)
    seen = view.east_north_m @ turn.T
    by_frame = np.zeros((len(seen), 2, 3))
    by_frame[:, 0, 0] = by_frame[:, 1, 1] = 1.0
    by_frame[:, 0, 2], by_frame[:, 1, 2] = seen[:, 1], -seen[:, 0]
    considered = by_frame @ frame.covariance @ transposed(by_frame)
    plain = _plain(view)
    return Sightings(
        plain.log,
        plain.source,
        plain.fresh,
        plain.identity,
        plain.track,
        frame.q_m + seen,
        turn @ view.covariance @ turn.T + considered,
        plain.altitude_m,
        plain.features,
    )


def told_by_a_plot(view: View) -> Array | None:
    """What one plot of a carrier tells of its frame, were the place of its target known.

    Its newest plots stand for those that may come from anywhere about it: each is turned all
    around, on average over which place and turn tell nothing of each other.

    Returns:
        (3, 3) information on (q, D); None without any plot.
    """
    if not view.log:
        return None
    weight = np.linalg.inv(view.plot_covariance)
    across = np.stack([view.plot_m[:, 1], -view.plot_m[:, 0]], axis=1)
    place = float(np.trace(weight, axis1=1, axis2=2).mean()) / 2
    return np.diag([place] * 2 + [float(np.einsum("ni,nij,nj->n", across, weight, across).mean())])


def network_logs(views: Sequence[View], targets: Sequence[Target]) -> NetworkLogs:
    """The plots of common targets that may serve now, where there are two of a target.

    Targets keep their numbers.
    """
    rows = [
        (member.carrier, number, member.row)
        for number, target in enumerate(targets)
        for member in _serving(views, target)
    ]
    table = np.array(rows, dtype=np.intp).reshape(-1, 3)
    logs = [_polar(view, table[table[:, 0] == k, 2]) for k, view in enumerate(views)]
    order = np.argsort(table[:, 0], kind="stable")
    carrier, target = table[order, 0], table[order, 1]
    return NetworkLogs(
        carrier,
        target,
        np.concatenate([log.bearing_rad for log in logs]),
        np.concatenate([log.range_m for log in logs]),
        np.concatenate([log.covariance for log in logs]),
    )


def _serving(views: Sequence[View], target: Target) -> list[Member]:
    """The members of a target whose plots may serve, if they are two or more."""
    serving = [member for member in target if views[member.carrier].ready[member.row]]
    return serving if len(serving) > 1 else []


def _polar(view: View, which: np.ndarray) -> PolarLogs:
    return PolarLogs.from_east_north(view.plot_m[which], view.plot_covariance[which])


def _plain(view: View) -> Sightings:
    return Sightings(*(getattr(view, field.name) for field in fields(Sightings)))


def _joined(one: Sightings, more: Sightings) -> Sightings:
    """Both, one after the other."""
    columns: list[Any] = []
    for field in fields(Sightings):
        a, b = getattr(one, field.name), getattr(more, field.name)
        columns.append(np.concatenate([a, b]) if isinstance(a, np.ndarray) else (*a, *b))
    return Sightings(*columns)
