"""The target logs of a source: coordinates, names, sigmas and ranges against what it declares."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from statistics import median

from ..messages import SourceProperties, SourceReport
from .findings import Notes

COORDINATES = {
    "bearing_range": ("bearing_rad", "range_m"),
    "bearing": ("bearing_rad",),
    "cartesian": ("east_m", "north_m"),
    "geodetic": ("latitude_rad", "longitude_rad"),
}
SIGMAS = {
    "bearing_rad": ("sigma_bearing_rad", "covariance_polar"),
    "range_m": ("sigma_range_m", "covariance_polar"),
    "east_m": ("sigma_position_m", "covariance_position"),
    "latitude_rad": ("sigma_position_m", "covariance_position"),
}
"""Which columns say how sure another is."""
GREATEST = {
    "sigma_bearing_rad": 0.26,
    "sigma_elevation_rad": 0.26,
    "sigma_range_m": 1e5,
    "sigma_position_m": 1e5,
}
LEAST = {
    "sigma_bearing_rad": 1e-6,
    "sigma_elevation_rad": 1e-6,
    "sigma_range_m": 1e-3,
    "sigma_position_m": 1e-3,
}
DEGREES = 57.3
DEFAULT_RATIO = 100.0
"""So far from the declared default, up or down, a sigma is no sigma of this source."""
DECLARED_RANGE_M = 1e8
"""A greater range_max_m declares nothing."""
MOST_OUTSIDE = 0.02
LEAST_RANGES = 20
KILOMETRES = 1 / 300
"""Were they metres, targets so near on the whole would be strange for the declared range."""
MAX_RANGES = 20_000


class LogsCheck:
    """Takes the reports of one source."""

    def __init__(self, carrier: str, source: str, notes: Notes) -> None:
        self._carrier, self._source, self._notes = carrier, source, notes
        self._logs: Counter[str] = Counter()
        self._features: dict[str, int] = {}
        self._ranges_m: list[float] = []
        self._sigmas: dict[str, list[float]] = {name: [] for name in GREATEST}
        self._without: Counter[str] = Counter()
        self._relative: list[float] = []

    def take(self, report: SourceReport) -> None:
        """Note one report."""
        if not len(report):
            return
        self._logs["all"] += len(report)
        for column in (*SIGMAS, "north_m", "longitude_rad"):
            self._logs[column] += _count(getattr(report, column))
        for name in report.features:
            self._features.setdefault(name, report.seq)
        self._note_names(report)
        self._note_sigmas(report)
        if len(self._ranges_m) < MAX_RANGES:
            self._ranges_m += [r for r in report.range_m or () if r is not None]

    def judge(self, notes: Notes, declared: SourceProperties | None, *, unheard: bool) -> None:
        """Say what is wrong, given what the source declares of itself.

        Args:
            unheard: it may have declared something before anybody listened.
        """
        if not self._logs["all"]:
            return

        def note(code: str, example: str, count: int = 1, detail: str = "") -> None:
            notes.add(code, self._carrier, self._source, example, count=count, detail=detail)

        kilometres = declared is not None and self._looks_like_kilometres(declared)
        if kilometres and declared:
            example = (
                f"half of the ranges are below {median(self._ranges_m):.3g}, range_max_m is "
                f"{declared.range_max_m:g}"
            )
            note("kilometres", example, len(self._ranges_m))
        if declared:
            self._judge_coordinates(note, declared)
            if not kilometres:
                self._judge_ranges(note, declared)
            for name in self._features.keys() - declared.features.keys():
                note("feature", f"{name}, first in seq {self._features[name]}", detail=name)
        if not unheard:
            self._judge_missing_sigmas(note, declared or SourceProperties())
        self._judge_sigmas(note, declared or SourceProperties(), kilometres)

    def _note_names(self, report: SourceReport) -> None:
        for column in ("identity", "track_id"):
            names = getattr(report, column) or [None] * len(report)
            kinds = report.identity_kind or [None] * len(report)
            keys = Counter((n, k) for n, k in zip(names, kinds, strict=True) if n)
            for (name, _), count in keys.items():
                if count > 1:
                    example = f"{column} {name} names {count} logs of seq {report.seq}"
                    self._notes.add("claimed_twice", self._carrier, self._source, example)

    def _note_sigmas(self, report: SourceReport) -> None:
        for column, said_by in SIGMAS.items():
            values = getattr(report, column)
            if values is None:
                continue
            told = [getattr(report, name) or [None] * len(report) for name in said_by]
            for i, value in enumerate(values):
                if value is not None and all(cells[i] is None for cells in told):
                    self._without[column] += 1
        for name, kept in self._sigmas.items():
            if len(kept) < MAX_RANGES:
                kept += [s for s in getattr(report, name) or () if s is not None]
        for sigma, value in zip(report.sigma_range_m or (), report.range_m or (), strict=False):
            if sigma and value and len(self._relative) < MAX_RANGES:
                self._relative.append(sigma / value)

    def _looks_like_kilometres(self, declared: SourceProperties) -> bool:
        limit_m = declared.range_max_m
        if limit_m > DECLARED_RANGE_M or len(self._ranges_m) < LEAST_RANGES:
            return False
        return median(self._ranges_m) < KILOMETRES * limit_m and max(self._ranges_m) < limit_m / 500

    def _judge_coordinates(self, note: Callable[..., None], declared: SourceProperties) -> None:
        wanted = COORDINATES[declared.coordinates]
        lacking = [name for name in wanted if not self._logs[name]]
        sent = [name for name in ("range_m", "east_m", "latitude_rad") if self._logs[name]]
        extra = declared.coordinates == "bearing" and sent
        if lacking or extra:
            held = ", ".join(name for name in SIGMAS if self._logs[name]) or "no coordinates"
            note("coordinates", f"declares {declared.coordinates}, its logs hold {held}")

    def _judge_ranges(self, note: Callable[..., None], declared: SourceProperties) -> None:
        slack_m = 5 * (declared.sigma_range_m or 0.0)
        low_m, high_m = declared.range_min_m - slack_m, declared.range_max_m + slack_m
        outside = [r for r in self._ranges_m if not low_m <= r <= 1.02 * high_m]
        if len(outside) > MOST_OUTSIDE * len(self._ranges_m):
            limits = f"{declared.range_min_m:g} to {declared.range_max_m:g} m"
            note("range_limits", f"a range of {outside[0]:.6g} m, declared {limits}", len(outside))

    def _judge_missing_sigmas(self, note: Callable[..., None], declared: SourceProperties) -> None:
        for column, count in self._without.items():
            if getattr(declared, SIGMAS[column][0]) is None:
                note("sigma_missing", f"{column} has neither a sigma nor a default", count, column)

    def _judge_sigmas(
        self, note: Callable[..., None], declared: SourceProperties, kilometres: bool
    ) -> None:
        for name, values in self._sigmas.items():
            for example, count in self._absurd(name, values, declared, kilometres):
                note("sigma_absurd", example, count, name)

    def _absurd(
        self, name: str, values: list[float], declared: SourceProperties, kilometres: bool
    ) -> Iterator[tuple[str, int]]:
        """The worst that can be said of a column of sigmas, if anything."""
        default = getattr(declared, name)
        own = [default] if default else []
        wrong = [s for s in (*own, *values) if not LEAST[name] <= s <= GREATEST[name]]
        if wrong:
            hint = ", which looks like degrees" if name in _ANGULAR and wrong[0] < DEGREES else ""
            yield f"{name} is {wrong[0]:.3g}{hint}", len(wrong)
            return
        typical = median(values) if values else default
        if default and typical and not 1 / DEFAULT_RATIO < typical / default < DEFAULT_RATIO:
            yield f"{name} is {typical:.3g}, its declared default {default:.3g}", len(values)
        elif name in _ANGULAR and default and typical and 45 < typical / default < 70:
            yield f"{name} is {typical:.3g}, the declared default in degrees", len(values)
        elif name == "sigma_range_m" and not kilometres and median(self._relative or [0]) > 1:
            yield "sigma_range_m exceeds the range itself", len(self._relative)


_ANGULAR = ("sigma_bearing_rad", "sigma_elevation_rad")


def _count(column: Iterable[object] | None) -> int:
    return sum(cell is not None for cell in column or ())
