"""Figures in words: quantities with their units, and what the page and the Markdown share."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from typing import Any, NamedTuple

from crossfix.quantities import UNKNOWN, quantity, seconds
from schemas.messages import DeclaredCarrier, DeclaredScenario, SourceProperties

from .accounts import LossFigures
from .sources import SourceFigures

COUNTED = {
    "received": "received",
    "duplicates": "duplicates",
    "gaps": "fetched again",
    "gave_up": "never had",
    "late": "late",
    "rejected": "refused",
    "unclaimed": "never claimed",
}
"""What the fusion centre counts of a stream -> in words."""


SOURCE_HEADINGS = ("logs", "associated", "of tracks", "of none", "NIS/dof", "interval")
SOURCES_NOTE = (
    "Over the second half of the run: target logs, those that were taken for one target with "
    "another carrier's, and plots that are of a track of the picture or of none. NIS is the "
    "squared distance of a plot from what its track had foretold, by the covariance of both; with "
    "honest sigmas its mean for each degree of freedom is 1, and lies in the interval in 95 % of "
    "all runs."
)


def source_cells(source: SourceFigures) -> tuple[str, ...]:
    """The row under `SOURCE_HEADINGS`."""
    low, high = source.nis_interval
    return (
        str(source.logs),
        str(source.associated),
        str(source.taken),
        str(source.lone),
        quantity(source.nis_per_dof, ".2f"),
        f"{low:.2f} to {high:.2f}" if source.nis_dof else UNKNOWN,
    )


def duration(span_s: float) -> str:
    """A span of time as people say it."""
    if span_s < 120:
        return f"{span_s:.4g} s"
    minutes, rest_s = divmod(round(span_s), 60)
    hours, minutes = divmod(minutes, 60)
    parts = ((hours, "h"), (minutes, "min"), (rest_s, "s"))
    return " ".join(f"{count} {unit}" for count, unit in parts if count)


def instant(t_ns: int) -> str:
    """A wall-clock time."""
    return datetime.fromtimestamp(t_ns // 10**9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def place(latitude_rad: float, longitude_rad: float) -> str:
    """Geodetic coordinates."""
    latitude, longitude = math.degrees(latitude_rad), math.degrees(longitude_rad)
    north, east = "N" if latitude >= 0 else "S", "E" if longitude >= 0 else "W"
    return f"{abs(latitude):.4f}° {north}, {abs(longitude):.4f}° {east}"


def losses(figures: LossFigures) -> str:
    """What was lost, by kind."""
    kinds = {COUNTED[name]: figures.totals[name] for name in ("gave_up", "rejected", "unclaimed")}
    kinds["dropped in a queue"] = sum(figures.queue_drops.values())
    kinds["not recorded"] = sum(figures.recorder.values())
    return ", ".join(f"{count} {words}" for words, count in kinds.items() if count)


class DeclaredRow(NamedTuple):
    """One line of the table of declared carriers and sources; cells in words."""

    carrier: str
    prior: tuple[str, str]
    source: str
    measures: str
    figures: tuple[str, ...]


def declared_rows(scenario: DeclaredScenario) -> Iterator[DeclaredRow]:
    """Every declared source beneath its carrier."""
    for carrier in scenario.carriers:
        sources: list[tuple[str, SourceProperties | None]] = [*carrier.sources.items()]
        for number, (name, properties) in enumerate(sources or [(UNKNOWN, None)]):
            yield _declared(carrier if number == 0 else None, name, properties)


def _declared(
    carrier: DeclaredCarrier | None, source: str, properties: SourceProperties | None
) -> DeclaredRow:
    p, prior = properties, ("", "")
    if carrier is not None:
        prior = _length(carrier.sigma_position_m), _angle(carrier.sigma_north_rad)
    return DeclaredRow(
        carrier=carrier.name if carrier else "",
        prior=prior,
        source=f"{source} ({p.kind})" if p and p.kind != source else source,
        measures=p.coordinates.replace("_", ", ") if p else UNKNOWN,
        figures=(
            seconds(p.period_s),
            _length(p.sigma_range_m),
            _angle(p.sigma_bearing_rad),
            quantity(100 * p.detection_probability, ".3g", " %"),
            quantity(p.range_max_m / 1000, ".3g", " km") if p.range_max_m < 1e8 else "unlimited",
        ) if p else (UNKNOWN,) * 5,
    )  # fmt: skip


def _length(declared_m: float | None) -> str:
    """As somebody wrote it: 30 m, and not 30.0 m."""
    return quantity(declared_m, ".4g", " m")


def _angle(declared_rad: float | None) -> str:
    return quantity(None if declared_rad is None else math.degrees(declared_rad), ".4g", "°")


def settings(fusion: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Declared fusion settings, by dotted name."""
    for name, value in fusion.items():
        if isinstance(value, Mapping):
            yield from settings(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", str(value)


def size(count: int) -> str:
    """A number of bytes."""
    return quantity(count / 1e6, ".1f", " MB") if count >= 1e5 else f"{count} bytes"
