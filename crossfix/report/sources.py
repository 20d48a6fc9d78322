"""How well each source agrees with the picture, over time: NIS, and what became of its logs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from scipy.special import chdtri

from estimation.arrays import Array, Indices
from schemas.messages import SourceQuality

from .story import Source, Story

MOST_PARTS, FEWEST = 60, 4
"""Of a run, over which squares are averaged, and instants in one of them."""
CONFIDENCE = 0.95


class SourceFigures(Struct, frozen=True, kw_only=True):
    """One source over the second half of the run.

    Attributes:
        logs: that were fused; associated: with another carrier's log.
        taken, lone: plots that are of a track of the picture, and of none.
        nis_per_dof: mean normalised squared innovation of the taken ones; nan without any.
        nis_interval: where it lies in 95 % of all runs when sigmas are honest.
    """

    carrier: str
    source: str
    logs: int
    associated: int
    taken: int
    lone: int
    nis_per_dof: float
    nis_dof: int
    nis_interval: tuple[float, float]


class SquaresOverTime(NamedTuple):
    """Normalised squares averaged over even parts of the run; nan where there were none.

    Attributes:
        t_s: (n,) middle of each part.
        mean: (n,) for each degree of freedom; low, high: where it lies if sigmas are honest (n,).
    """

    t_s: Array
    mean: Array
    low: Array
    high: Array


class Told(NamedTuple):
    """What the fusion centre told of a source at one instant."""

    t_s: float
    quality: SourceQuality


def told_of(story: Story) -> dict[Source, list[Told]]:
    """Everything told of each source, own carrier's first."""
    order = {name: number for number, name in enumerate(story.carriers)}
    found: dict[Source, list[Told]] = {}
    for quality in story.qualities:
        t_s = story.time_s(quality.t_ns)
        for source in quality.sources:
            found.setdefault((source.carrier, source.source), []).append(Told(t_s, source))
    return dict(
        sorted(found.items(), key=lambda item: (order.get(item[0][0], len(order)), item[0]))
    )


def source_figures(story: Story) -> list[SourceFigures]:
    """Of every source that said something, by carrier."""
    half_s = story.time_s(story.end_ns) / 2
    return [
        _figures(source, [t.quality for t in told if t.t_s > half_s])
        for source, told in told_of(story).items()
    ]


def _figures(source: Source, rows: Sequence[SourceQuality]) -> SourceFigures:
    dof = sum(row.track_nis_dof for row in rows)
    low, high = mean_interval(np.array([dof]))
    return SourceFigures(
        carrier=source[0],
        source=source[1],
        logs=sum(row.logs for row in rows),
        associated=sum(row.associated for row in rows),
        taken=sum(row.taken for row in rows),
        lone=sum(row.lone for row in rows),
        nis_per_dof=sum(row.track_nis * row.track_nis_dof for row in rows) / dof if dof else np.nan,
        nis_dof=dof,
        nis_interval=(float(low[0]), float(high[0])),
    )


def nis_over_time(told: Sequence[Told], end_s: float) -> SquaresOverTime:
    """NIS of one source in a run of this length."""
    t_s = np.array([t.t_s for t in told])
    dof = np.array([t.quality.track_nis_dof for t in told], dtype=float)
    return squares_over_time(t_s, dof * [t.quality.track_nis for t in told], dof, end_s)


def squares_over_time(t_s: Array, squares: Array, dof: Array, end_s: float) -> SquaresOverTime:
    """Sums of normalised squares (n,) with their degrees of freedom, at instants, averaged.

    Args:
        end_s: length of the run.
    """
    count = int(np.clip(np.count_nonzero(dof) // FEWEST, 1, MOST_PARTS))
    edges = np.linspace(0.0, max(end_s, 1e-9), count + 1)
    part = np.clip(np.searchsorted(edges, t_s, side="left") - 1, 0, count - 1)
    dof_of = np.bincount(part, dof, minlength=count)
    with np.errstate(invalid="ignore"):
        mean = np.bincount(part, np.where(dof > 0, squares, 0.0), minlength=count) / dof_of
    return SquaresOverTime((edges[1:] + edges[:-1]) / 2, mean, *mean_interval(dof_of))


def mean_interval(dof: Array | Indices) -> tuple[Array, Array]:
    """Where a mean over `dof` (n,) degrees of freedom lies, if honest; nan where there are none."""
    some = np.where(dof > 0, dof, np.nan)
    rest = (1 - CONFIDENCE) / 2
    return chdtri(some, 1 - rest) / some, chdtri(some, rest) / some
