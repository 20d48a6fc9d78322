"""Do the measurements scatter as much as their sigmas claim? From the measurements alone.

Three successive plots of one named target lie on a straight line but for their errors and the
target's acceleration. What the middle one is off the line between its neighbours, divided by what
the claimed sigmas make of it, has mean square one. The median over many such residuals is compared
with that of chi-squared, so that manoeuvres and swapped names do not decide; no two residuals of a
track share a plot, so that they are independent and the confidence is what it says.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from itertools import pairwise
from math import exp, isfinite, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..messages import SourceProperties, SourceReport

Array = NDArray[np.float64]
MAX_TRACKS = 500
MAX_PLOTS = 1500
LEAST_RESIDUALS = 40
MOST_PERIODS = 3.0
"""Plots further apart are not joined by a line."""
SIGMA_ACCELERATION_MPS2 = 1.0
"""What targets may do between plots; only widens what is expected."""
MEDIAN = 0.45494
"""Of chi-squared with one degree of freedom."""
RELATIVE_SIGMA = 1.167
"""Of the root of such a median over n, times sqrt(n)."""
Z = 4.0
"""Two-sided confidence 99.994 %."""
TOO_SMALL, TOO_LARGE = 1.25, 0.6
"""Scatter by claim, beyond which a claim is wrong when the whole interval lies beyond it."""
NS = 1e-9


class SigmaCheck(NamedTuple):
    """Scatter of one coordinate by its claimed sigma: estimate, interval, number of residuals."""

    column: str
    ratio: float
    low: float
    high: float
    number: int

    @property
    def verdict(self) -> str:
        """`too small` or `too large` for the claim, `consistent`, or `too few to say`."""
        if self.number < LEAST_RESIDUALS:
            return "too few to say"
        if self.low > TOO_SMALL:
            return "too small"
        return "too large" if self.high < TOO_LARGE else "consistent"


class _Plot(NamedTuple):
    t_ns: int
    place_m: tuple[float, float]
    """Along two axes, across which errors are independent of each other."""
    bearing_rad: float
    sigmas: tuple[float | None, float | None]
    """Range and bearing, or both axes; None = the source's default."""


class Residuals:
    """Collects the named plots of one source."""

    def __init__(self) -> None:
        self._tracks: OrderedDict[str, list[_Plot]] = OrderedDict()
        self._polar = self._filtered = False

    def take(self, report: SourceReport) -> None:
        """Note the named logs of a report that have a place."""
        for i in range(len(report)):
            name = _name(report, i)
            plot = _plot(report, i)
            if not name or plot is None:
                continue
            self._polar |= report.range_m is not None
            self._filtered |= report.kind is not None and report.kind[i] != "plot"
            track = self._tracks.setdefault(name, [])
            if len(track) < MAX_PLOTS and (not track or plot.t_ns > track[-1].t_ns):
                track.append(plot)
            if len(self._tracks) > MAX_TRACKS:
                self._tracks.popitem(last=False)

    def checks(self, declared: SourceProperties) -> list[SigmaCheck]:
        """One check for each coordinate there is, whether enough is known or not."""
        defaults = _defaults(declared, self._polar)
        rows = [row for track in self._tracks.values() for row in _rows(track, declared, defaults)]
        squares = np.array(rows).reshape(-1, 2)
        names = ("sigma_range_m", "sigma_bearing_rad") if self._polar else ("sigma_position_m",)
        columns = squares.T if self._polar else [squares.ravel()]
        checks = [_check(name, column) for name, column in zip(names, columns, strict=True)]
        smooth = self._filtered or declared.sends_tracks
        # A filter's errors hang together: they scatter less than they are, never more.
        return [c for c in checks if not (smooth and c.verdict == "too large")]

    def leaps(self, declared: SourceProperties, max_speed_mps: float) -> Iterator[str]:
        """Names that went further between two plots than any target does, in words."""
        defaults = _defaults(declared, self._polar)
        for name, track in self._tracks.items():
            for one, two in pairwise(track):
                moved_m = np.hypot(*np.subtract(two.place_m, one.place_m))
                passed_s = (two.t_ns - one.t_ns) * NS
                sigma_m = sum(_spread_m(plot, defaults, self._polar) for plot in (one, two))
                if moved_m > max_speed_mps * passed_s + 6 * sigma_m:
                    yield f"{name} moved {moved_m:.4g} m in {passed_s:.3g} s"
                    break


def _check(column: str, squares: Array) -> SigmaCheck:
    count = len(squares)
    if not count:
        return SigmaCheck(column, 1.0, 0.0, float("inf"), 0)
    ratio = sqrt(float(np.median(squares)) / MEDIAN)
    spread = exp(Z * RELATIVE_SIGMA / sqrt(count))
    return SigmaCheck(column, ratio, ratio / spread, ratio * spread, count)


def _rows(
    track: list[_Plot], declared: SourceProperties, defaults: tuple[float, float]
) -> Iterator[tuple[float, float]]:
    """Normalised squares along both axes of every third plot against its neighbours."""
    polar = not np.isnan(track[0].bearing_rad)
    longest_s = MOST_PERIODS * declared.period_s
    for k in range(1, len(track) - 1, 3):
        before, here, after = track[k - 1 : k + 2]
        one_s, two_s = (here.t_ns - before.t_ns) * NS, (after.t_ns - here.t_ns) * NS
        if max(one_s, two_s) > longest_s:
            continue
        w = two_s / (one_s + two_s)
        line = w * np.array(before.place_m) + (1 - w) * np.array(after.place_m)
        covariance = (
            _covariance(here, defaults, polar)
            + w**2 * _covariance(before, defaults, polar)
            + (1 - w) ** 2 * _covariance(after, defaults, polar)
            + np.eye(2) * (SIGMA_ACCELERATION_MPS2 * one_s * two_s / 2) ** 2
        )
        axes = _axes(here.bearing_rad) if polar else np.eye(2)
        off = axes @ (np.array(here.place_m) - line)
        variances = np.einsum("ij,jk,ik->i", axes, covariance, axes)
        if np.isfinite(variances).all() and variances.min() > 0:
            along, across = (off**2 / variances).tolist()
            yield along, across


def _covariance(plot: _Plot, defaults: tuple[float, float], polar: bool) -> Array:
    """Of a plot's place (2, 2), east and north."""
    first, second = (own or default for own, default in zip(plot.sigmas, defaults, strict=True))
    if not polar:
        return np.diag([first**2, second**2])
    axes = _axes(plot.bearing_rad)
    across_m = second * float(np.hypot(*plot.place_m))
    return axes.T @ np.diag([first**2, across_m**2]) @ axes


def _spread_m(plot: _Plot, defaults: tuple[float, float], polar: bool) -> float:
    """One sigma of a plot's place in any direction; 0 where nobody says."""
    variance = float(_covariance(plot, defaults, polar).trace())
    return sqrt(variance) if isfinite(variance) else 0.0


def _axes(bearing_rad: float) -> Array:
    """Unit vectors along and across a bearing, as rows of east and north."""
    sine, cosine = np.sin(bearing_rad), np.cos(bearing_rad)
    return np.array([[sine, cosine], [cosine, -sine]])


def _plot(report: SourceReport, i: int) -> _Plot | None:
    """The i-th log as a place, if its sigmas are told by columns or left to the source."""
    offset_s = _cell(report.time_offset_s, i) or 0.0
    t_ns = report.t_ns + round(offset_s / NS)
    bearing, slant = _cell(report.bearing_rad, i), _cell(report.range_m, i)
    if bearing is not None and slant is not None:
        if report.covariance_polar is not None:
            return None
        level = slant * float(np.cos(_cell(report.elevation_rad, i) or 0.0))
        place = (level * float(np.sin(bearing)), level * float(np.cos(bearing)))
        sigmas = _cell(report.sigma_range_m, i), _cell(report.sigma_bearing_rad, i)
        return _Plot(t_ns, place, bearing, sigmas)
    east, north = _cell(report.east_m, i), _cell(report.north_m, i)
    if east is None or north is None:
        return None
    triangle = report.covariance_position[i] if report.covariance_position else None
    sigma = _cell(report.sigma_position_m, i)
    if triangle is not None:
        second = triangle[2] if len(triangle) == 3 else triangle[3]
        return _Plot(t_ns, (east, north), float("nan"), (sqrt(triangle[0]), sqrt(second)))
    return _Plot(t_ns, (east, north), float("nan"), (sigma, sigma))


def _defaults(declared: SourceProperties, polar: bool) -> tuple[float, float]:
    nan = float("nan")
    if polar:
        return declared.sigma_range_m or nan, declared.sigma_bearing_rad or nan
    return declared.sigma_position_m or nan, declared.sigma_position_m or nan


def _name(report: SourceReport, i: int) -> str:
    for column in (report.track_id, report.identity):
        if column is not None and column[i]:
            return str(column[i])
    return ""


def _cell(column: list[float | None] | None, i: int) -> float | None:
    value = column[i] if column is not None else None
    return value if value is not None and isfinite(value) else None
