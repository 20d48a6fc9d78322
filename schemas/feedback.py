"""What a carrier says in its corrected frame, and the same without the correction.

A carrier that uses the corrections it is sent adds their `Feedback` to its pose and turns its
target logs by as much as its north. It says which correction that was, and what it has added, so
that whoever works with its own frame takes it out again: a pose to the bit, logs to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, pi, remainder, sin
from typing import NamedTuple, TypeVar

from msgspec.structs import replace

from .messages import (
    Correction,
    Feedback,
    Increment,
    Input,
    Navigation,
    Pose,
    SourceReport,
    TrackFilter,
)
from .messages.values import order_of_triangle

TURN = 2 * pi
WINDOW = 8
"""In lock-step a correction of step k is applied from step k + WINDOW on: the world grants that
step only after the fusion centre has acknowledged step k."""
T = TypeVar("T")
NS = 1e-9
_STEP_DIGITS = 18


class Corrected(NamedTuple):
    """A correction as a carrier has applied it.

    Attributes:
        id: of the correction.
        pose: the carrier's own with it.
        turned_rad: what it adds to bearings.
    """

    id: str
    pose: Pose
    turned_rad: float


def applied(
    correction: Correction | None,
    navigation: Navigation,
    since_ns: int,
) -> Corrected | None:
    """A correction put to the pose of a moment; None if there is none to be applied.

    Args:
        navigation: of now, without any correction.
        since_ns: since when the carrier errs as it does now: the start of its life, or a fix. What
            was found of before holds no longer.
    """
    if correction is None or correction.state != "applied" or correction.feedback is None:
        return None
    if correction.valid_t_ns < since_ns:
        return None
    passed_s = (navigation.t_ns - correction.valid_t_ns) * NS
    pose = moved(navigation.pose, correction.feedback, passed_s)
    if abs(pose.latitude_rad) > pi / 2:
        return None
    grown = 1.0 + (passed_s / correction.valid_for_s) ** 2 if correction.valid_for_s else 1.0
    astray_m2 = correction.feedback.wander_m2_s * abs(passed_s)
    covariance = _spread(correction.feedback.covariance, grown, astray_m2)
    pose = replace(pose, covariance=covariance)
    return Corrected(correction.id, pose, correction.feedback.north_rad)


def correction_id(centre: str, carrier: str, step: int) -> str:
    """The name of the correction that a fusion centre makes for a carrier at a step."""
    return f"{centre}/{carrier}/{step}"


def renamed_id(name: str, carrier: str) -> str:
    """The name of a correction, made out to a carrier that is called otherwise."""
    parts = name.split("/")
    return "/".join((parts[0], carrier, parts[2])) if len(parts) == 3 else name


def is_sent(name: str, centre: str, carrier: str, before_step: int) -> bool:
    """Whether a name can be that of a correction sent to a carrier before a step."""
    _, _, step = name.rpartition("/")
    if not step.isdecimal() or len(step) > _STEP_DIGITS:
        return False
    return 1 <= int(step) < before_step and name == correction_id(centre, carrier, int(step))


def corrected(message: Input, held: Corrected | None) -> Input:
    """What a carrier is about to say, in its corrected frame."""
    if held is None:
        return message
    if isinstance(message, Navigation):
        return replace(message, pose=held.pose, correction_id=held.id, uncorrected=message.pose)
    if isinstance(message, SourceReport):
        turned = _turned(message, held.turned_rad)
        return replace(turned, correction_id=held.id, turned_rad=held.turned_rad)
    return message


def uncorrected(message: Input) -> Input:
    """What a carrier has said, without the correction it says to hold.

    Raises:
        ValueError: it does not say what it is without.
    """
    if isinstance(message, Navigation):
        return own_navigation(message)
    return own_report(message) if isinstance(message, SourceReport) else message


def own_navigation(said: Navigation) -> Navigation:
    """The navigation without a correction.

    Raises:
        ValueError: it does not say what it is without.
    """
    if not said.correction_id:
        return said
    if said.uncorrected is None:
        raise ValueError("does not say its pose without it")
    return replace(said, pose=said.uncorrected, correction_id="", uncorrected=None)


def own_report(said: SourceReport) -> SourceReport:
    """The report without a correction.

    Raises:
        ValueError: a covariance in it is so nearly singular that it cannot be turned.
    """
    if not said.correction_id:
        return said
    return replace(_turned(said, -said.turned_rad), correction_id="", turned_rad=0.0)


def _turned(report: SourceReport, angle_rad: float) -> SourceReport:
    """The report with all its directions clockwise by an angle."""
    turn = _Turn(cos(angle_rad), sin(angle_rad))
    east, north = turn.columns(report.east_m, report.north_m)
    velocity_east, velocity_north = turn.columns(
        report.velocity_east_mps, report.velocity_north_mps
    )
    swept = report.swept and replace(
        report.swept, start_rad=(report.swept.start_rad + angle_rad) % TURN
    )
    bearing = report.bearing_rad and [
        b if b is None else (b + angle_rad) % TURN for b in report.bearing_rad
    ]
    return replace(
        report,
        swept=swept,
        bearing_rad=bearing,
        east_m=east,
        north_m=north,
        covariance_position=_each(turn.triangle, report.covariance_position),
        velocity_east_mps=velocity_east,
        velocity_north_mps=velocity_north,
        covariance_velocity=_each(turn.triangle, report.covariance_velocity),
        filter=_each(turn.filter, report.filter),
        increment=_each(turn.increment, report.increment),
    )


def moved(pose: Pose, feedback: Feedback, passed_s: float) -> Pose:
    """A pose with what a correction adds to it, so long after it was found."""
    latitude = feedback.latitude_rad + passed_s * feedback.latitude_rad_s
    longitude = feedback.longitude_rad + passed_s * feedback.longitude_rad_s
    return replace(
        pose,
        latitude_rad=pose.latitude_rad + latitude,
        longitude_rad=remainder(pose.longitude_rad + longitude, TURN),
        heading_rad=remainder(pose.heading_rad + feedback.north_rad, TURN),
    )


def _spread(covariance: list[float], grown: float, astray_m2: float) -> list[float]:
    """The covariance of (east, north, own north) with that of the place grown, and added to."""
    ee, en, ea, nn, na, aa = covariance
    root = grown**0.5
    return [ee * grown + astray_m2, en * grown, ea * root, nn * grown + astray_m2, na * root, aa]


class _Turn(NamedTuple):
    """A rotation of the level plane, clockwise."""

    cosine: float
    sine: float

    def pair(self, east: float, north: float) -> tuple[float, float]:
        """A vector, turned."""
        return self.cosine * east + self.sine * north, self.cosine * north - self.sine * east

    def columns(self, east: _Column, north: _Column) -> tuple[_Column, _Column]:
        """Two columns of a report; a log that has not both is left as it is."""
        if east is None or north is None:
            return east, north
        pairs = [
            (e, n) if e is None or n is None else self.pair(e, n)
            for e, n in zip(east, north, strict=True)
        ]
        return [e for e, _ in pairs], [n for _, n in pairs]

    def vector(self, values: Sequence[float]) -> list[float]:
        """East and north, then their rates and so on; what is left over is no pair."""
        pairs = zip(values[::2], values[1::2], strict=False)
        turned = [value for pair in pairs for value in self.pair(*pair)]
        return [*turned, *values[len(turned) :]]

    def triangle(self, upper: list[float]) -> list[float]:
        """The upper triangle of a symmetric matrix over such a vector: its rows and columns."""
        n = order_of_triangle(len(upper))
        starts = [i * n - i * (i + 1) // 2 for i in range(n)]
        rows = [[upper[starts[min(i, j)] + max(i, j)] for j in range(n)] for i in range(n)]
        half = [self.vector(row) for row in rows]
        whole = [self.vector(column) for column in zip(*half, strict=True)]
        return [whole[i][j] for i in range(n) for j in range(i, n)]

    def filter(self, behind: TrackFilter) -> TrackFilter:
        """The filter behind a log."""
        state, covariance = self.vector(behind.state), self.triangle(behind.covariance)
        return replace(behind, state=state, covariance=covariance)

    def increment(self, gained: Increment) -> Increment:
        """New information, if it is along the axes of the carrier."""
        if gained.frame != "carrier":
            return gained
        y, information = self.vector(gained.y), self.triangle(gained.information)
        return replace(gained, y=y, information=information)


_Column = list[float | None] | None


def _each(turn: Callable[[T], T], column: Sequence[T | None] | None) -> list[T | None] | None:
    return None if column is None else [cell if cell is None else turn(cell) for cell in column]
