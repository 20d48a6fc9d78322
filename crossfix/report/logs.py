"""Target logs as points of the picture: as reported, and by the correction then in force."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crossfix.own_frames import as_own
from estimation.arrays import Array
from estimation.frames import on_surface, rotation_clockwise, target_from_source
from fusion_center.navigation import way_m
from fusion_center.sources.coordinates import Observer, instants_ns, places
from schemas.messages import Correction, FixedAxes, SourceProperties, SourceReport

from .axes import Axes, View
from .story import Story

UNNAMED = "unnamed"


class Logs(NamedTuple):
    """Target logs as points.

    Attributes:
        t_s: (n,); east_north_m: (n, 2) in the picture's axes.
        name: (n,) index into the names of the scene.
    """

    t_s: Array
    east_north_m: Array
    name: NDArray[np.int32]


class Names:
    """Numbers names as they come."""

    def __init__(self) -> None:
        self.index: dict[str, int] = {}

    def numbers(self, names: Iterable[str]) -> NDArray[np.int32]:
        """The number of each name."""
        index = self.index
        return np.array([index.setdefault(name, len(index)) for name in names], dtype=np.int32)


class _Seen(NamedTuple):
    """The logs of one report that have a place: along the carrier's own axes."""

    t_ns: int
    view: View
    t_s: Array
    east_north_m: Array
    altitude_m: Array
    name: NDArray[np.int32]

    def reported(self) -> Logs:
        """Where the carrier's own navigation puts them."""
        placed = self.view.placed(self.east_north_m, self.altitude_m)
        return Logs(self.t_s, placed, self.name)

    def corrected(self, own: View, fixed: FixedAxes) -> Logs:
        """Where a correction puts them: by the own carrier's place and axes."""
        in_own = self._along_own_axes(own, fixed)
        return Logs(self.t_s, own.placed(in_own, self.altitude_m), self.name)

    def _along_own_axes(self, own: View, fixed: FixedAxes) -> Array:
        """Places q + R(D) log, as `estimation.relative_frame.in_own_axes` defines (q, D)."""
        own_from_other = target_from_source(own.site, self.view.site)
        east, north = self.east_north_m.T
        enu = on_surface(self.view.site, east, north, self.altitude_m)
        relative = enu @ own_from_other.rotation[:2].T
        shift = np.array([fixed.offset_east_m, fixed.offset_north_m])
        offset = own_from_other.translation_m[:2] + shift
        q = rotation_clockwise(-fixed.c1_rad) @ offset
        in_own: Array = q + relative @ rotation_clockwise(fixed.c2_rad - fixed.c1_rad).T
        return in_own


def logs_of(story: Story, axes: Axes, carrier: str, names: Names) -> tuple[Logs, Logs]:
    """All logs of a carrier, as reported and as corrected; the own carrier's need no correction.

    What a carrier reports that applies its corrections holds them already; as corrected the logs
    of all carriers are drawn alike.
    """
    seen = [*_seen(story, axes, carrier, names)]
    reported = [s.reported() for s in seen]
    if carrier == story.own:
        return _joined(reported), _joined(())
    if any(message.correction_id for message in story.navigation.get(carrier, ())):
        seen = [*_seen(story, axes.uncorrected, carrier, names, as_own)]
    return _joined(reported), _joined(_corrected(story, axes, carrier, seen))


def _as_said(report: SourceReport) -> SourceReport:
    return report


def _seen(
    story: Story,
    axes: Axes,
    carrier: str,
    names: Names,
    taken: Callable[[SourceReport], SourceReport] = _as_said,
) -> Iterator[_Seen]:
    for (sender, source), reports in story.reports.items():
        if sender == carrier:
            properties = story.sources.get((carrier, source), SourceProperties())
            for report in map(taken, reports):
                if (seen := _placed(story, axes, report, properties, names)) is not None:
                    yield seen


def _placed(
    story: Story, axes: Axes, report: SourceReport, properties: SourceProperties, names: Names
) -> _Seen | None:
    """The logs of a report that have a place; None before the carrier's first navigation."""
    navigation = axes.navigation(report.carrier, report.t_ns)
    view = axes.view(report.carrier, report.t_ns)
    if view is None:
        return None
    instants = instants_ns(report)
    moved_m = way_m(navigation, instants) - way_m(navigation, report.t_ns)
    found = places(report, properties, Observer(view.site, moved_m), 0.0)
    which = np.flatnonzero(found.located)
    called = log_names(report)
    t_s = np.multiply(instants[which] - story.start_ns, 1e-9, dtype=np.float64)
    return _Seen(
        report.t_ns,
        view,
        t_s,
        (found.east_north_m + moved_m)[which],
        found.altitude_m[which],
        names.numbers(called[i] for i in which),
    )


def _corrected(story: Story, axes: Axes, carrier: str, seen: Iterable[_Seen]) -> Iterator[Logs]:
    corrections = story.corrections.get(carrier, ())
    for logs in seen:
        fixed = _in_force(corrections, logs.t_ns)
        own = axes.view(story.own, logs.t_ns)
        if fixed is not None and own is not None:
            yield logs.corrected(own, fixed)


def _in_force(corrections: Sequence[Correction], t_ns: int) -> FixedAxes | None:
    """The last correction closed before an instant, if it is one that is applied."""
    end = bisect_right(corrections, t_ns, key=lambda correction: correction.t_ns)
    last = corrections[end - 1] if end else None
    return last.fixed_axes if last is not None and last.state == "applied" else None


def log_names(report: SourceReport) -> list[str]:
    """What a person would call each log: its identity, else its track, else its class."""
    columns: list[Sequence[str | None]] = [
        column for column in (report.identity, report.track_id) if column is not None
    ]
    if report.classes is not None:
        columns.append(["/".join(names or ()) for names in report.classes])
    if not columns:
        return [UNNAMED] * len(report)
    return [next(filter(None, row), UNNAMED) for row in zip(*columns, strict=True)]


def _joined(logs: Iterable[Logs]) -> Logs:
    parts = [*logs]
    return Logs(
        np.concatenate([np.zeros(0), *(part.t_s for part in parts)]),
        np.concatenate([np.zeros((0, 2)), *(part.east_north_m for part in parts)]),
        np.concatenate([np.zeros(0, dtype=np.int32), *(part.name for part in parts)]),
    )
