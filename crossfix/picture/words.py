"""Figures in words: quantities with their units, and what the page and the Markdown share."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from typing import Any, NamedTuple

from schemas.messages import DeclaredCarrier, DeclaredScenario, SourceProperties

from .accounts import LossFigures
from .figures import PictureTruth

NOTHING = "-"
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


def metres(value: float | None) -> str:
    """A length."""
    return quantity(value, ".0f", " m")


def degrees(radians: float | None) -> str:
    """An angle."""
    return quantity(None if radians is None else math.degrees(radians), ".2f", "°")


def seconds(value: float | None) -> str:
    """An instant or a span."""
    return quantity(value, ".4g", " s")


def quantity(value: float | None, form: str, unit: str = "") -> str:
    """A number with its unit; what is not known is a dash."""
    return NOTHING if value is None or math.isnan(value) else f"{value:{form}}{unit}"


def picture_cells(truth: PictureTruth) -> tuple[str, ...]:
    """The row under `crossfix.table.PICTURE_HEADINGS`."""
    return (
        quantity(truth.targets, ".1f"),
        quantity(truth.tracks, ".1f"),
        quantity(truth.missed, ".2f"),
        quantity(truth.false, ".2f"),
        quantity(truth.gospa_m, ".1f", " m"),
        quantity(truth.error_m, ".1f", " m"),
        quantity(truth.nees_per_dimension, ".2f"),
        str(truth.identity_changes),
    )


def applying(said_m: float | None) -> str:
    """That a carrier applies its corrections, and what comes of it."""
    if said_m is None:
        return "applies its corrections"
    return f"applies its corrections: the place it reports then errs by {metres(said_m)}"


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
        for number, (name, properties) in enumerate(sources or [(NOTHING, None)]):
            yield _declared(carrier if number == 0 else None, name, properties)


def _declared(
    carrier: DeclaredCarrier | None, source: str, properties: SourceProperties | None
) -> DeclaredRow:
    p, prior = properties, ("", "")
    if carrier is not None:
        prior = metres(carrier.sigma_position_m), degrees(carrier.sigma_north_rad)
    return DeclaredRow(
        carrier=carrier.name if carrier else "",
        prior=prior,
        source=f"{source} ({p.kind})" if p and p.kind != source else source,
        measures=p.coordinates.replace("_", ", ") if p else NOTHING,
        figures=(
            seconds(p.period_s),
            metres(p.sigma_range_m),
            degrees(p.sigma_bearing_rad),
            quantity(100 * p.detection_probability, ".3g", " %"),
            quantity(p.range_max_m / 1000, ".3g", " km") if p.range_max_m < 1e8 else "unlimited",
        ) if p else (NOTHING,) * 5,
    )  # fmt: skip


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
