"""One report as the picture takes it: plots, where they can come from, how well they are seen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.tracking.measurements import Measurement, bearings, places
from estimation.tracking.measurements.polar import polar
from estimation.tracking.scan import Scan, View
from schemas.messages import SourceProperties, SourceReport

from ..group import chosen
from ..navigation import NS, pose_at, site, way_m
from ..sources.coordinates import Observer, column, instants_ns
from ..sources.coordinates import places as located
from ..sources.features import CLASS, NOTHING_LEARNED, Heard, heard
from ..sources.news import NOTHING_TOLD, has_tracks, news
from ..state import State, Told, Watched
from .axes import Placed
from .classes import classes_of, evidence
from .watch import false_plots

LEAST_DETECTION, MOST_DETECTION = 0.05, 0.98
LEAST_REACH_M, MOST_REACH_M = 1_000.0, 200_000.0
MOST_PLACE_M = 1e7


class Plots(NamedTuple):
    """A scan for the picture.

    Attributes:
        log: (m,) which log of the report each of its plots is.
        told: what is to be remembered of a source that sends tracks; None of others.
        heard: what they say of features; None = nothing.
    """

    scan: Scan
    log: NDArray[np.intp]
    told: Told | None = None
    heard: Heard | None = None


class _Taken(NamedTuple):
    """Measurements, the logs they are of, and as in `Plots`."""

    measured: Measurement
    log: NDArray[np.intp]
    told: Told | None = None


def plots(state: State, report: SourceReport, axes: Placed) -> Plots | None:
    """What the picture takes of a report; None where nothing in it can be placed."""
    properties = state.sources(report.carrier).get(report.stream, SourceProperties())
    passive = properties.coordinates == "bearing"
    taken = _lines(report, properties, axes) if passive else _places(state, report, axes)
    measured, index, memory = taken
    if not len(index) and len(report) and memory is None:
        return None
    view = _view(properties, axes)
    declared = properties.clutter_per_scan + state.settings.tracking.clutter_per_scan
    count = state.picture.watched.get(told_key(state, report), Watched())
    false = false_plots(count, declared)
    reach = min(view.range_max_m, _farthest_m(view, measured) if false > declared else MOST_REACH_M)
    extent = view.width_rad if passive else view.width_rad / 2 * reach**2
    share = len(index) / len(report) if memory is not None and len(report) else 1.0
    seen = share * properties.detection_probability
    detection = float(np.clip(seen, LEAST_DETECTION if share else 0.0, MOST_DETECTION))
    life = f"{report.carrier}/{state.carriers[report.carrier].boot}"
    common = axes.common(life, report.stream)
    scan = Scan(report.t_ns, measured, view, detection, false / extent, common)
    classes, told = classes_of(state.scenario), properties.features.get(CLASS)
    learned = state.picture.learned.get(told_key(state, report), NOTHING_LEARNED)
    trust = state.settings.picture.class_trust
    told_of = evidence(report, index, classes, told, trust, learned)
    by_features = heard(report, index, properties, state.picture.dictionary, learned)
    scan = scan._replace(evidence=told_of, features=by_features and by_features.said)
    return Plots(scan, index, memory, by_features)


def _places(state: State, report: SourceReport, axes: Placed) -> _Taken:
    """Plots with places: by bearing and range where they were measured so."""
    navigation = state.carriers[report.carrier].navigation
    properties = state.sources(report.carrier).get(report.stream, SourceProperties())
    at_ns, way = instants_ns(report), way_m(navigation, report.t_ns)
    late = chosen.lateness(state, report.carrier, report.stream)
    moved = way_m(navigation, at_ns - round(late.of_source_s / NS)) - way
    observer = Observer(site(pose_at(navigation, report.t_ns)), moved)
    found = located(report, properties, observer, state.settings.logs.target_altitude_m)
    told = None
    if has_tracks(report, properties):
        before = state.picture.told.get(told_key(state, report), NOTHING_TOLD)
        found, told = news(before, report, properties, found, moved + way)
    index = np.flatnonzero(found.usable)
    here = found.east_north_m[index]
    ranges = axes.ranges(report.stream)
    if not ranges.none:
        here = here + ranges.added(here)
    here = here + moved[index]
    place = axes.places_m(here, found.altitude_m[index])
    covariance = axes.turned(found.covariance[index])
    sane = np.flatnonzero(_are_sane(place, covariance))
    index, place, covariance = index[sane], place[sane], covariance[sane]
    offset: Array = np.multiply(at_ns[index] - report.t_ns, NS) - late.seconds
    jitter = np.nan_to_num(column(report.sigma_time_offset_s, len(report)))[index]
    jitter = np.hypot(jitter, late.sigma_s)
    if report.bearing_rad is None or report.range_m is None:
        return _Taken(places(place, covariance, offset, jitter), index, told)
    return _Taken(_by_bearing(axes.place_m(), place, covariance, (offset, jitter)), index, told)


def told_key(state: State, report: SourceReport) -> str:
    """What the memory of a source is called: another life of its carrier has another."""
    return f"{report.carrier}/{state.carriers[report.carrier].boot}/{report.stream}"


def _are_sane(place: Array, covariance: Array) -> NDArray[np.bool_]:
    """(m,) which plots are on this planet, with a covariance that is one."""
    near: NDArray[np.bool_] = np.hypot(*place.T) < MOST_PLACE_M
    spread, turned = np.trace(covariance, axis1=1, axis2=2), np.linalg.det(covariance)
    return np.asarray(near & (spread < MOST_PLACE_M**2) & (turned > 0) & np.isfinite(turned))


def _by_bearing(
    site_m: Array, place: Array, covariance: Array, late: tuple[Array, Array]
) -> Measurement:
    """The same as bearings and level ranges from where the carrier is in the picture."""
    east, north = (place - site_m).T
    far = np.maximum(np.hypot(east, north), 1.0)
    along = np.stack([east, north], axis=1) / far[:, None]
    across = np.stack([along[:, 1], -along[:, 0]], axis=1)
    sigma_range = np.sqrt(np.einsum("ni,nij,nj->n", along, covariance, along))
    sigma_bearing = np.sqrt(np.einsum("ni,nij,nj->n", across, covariance, across)) / far
    return polar(site_m, np.arctan2(east, north), far, sigma_bearing, sigma_range, *late)


def _lines(report: SourceReport, properties: SourceProperties, axes: Placed) -> _Taken:
    """Bearings of a passive source."""
    n = len(report)
    bearing, sigma = column(report.bearing_rad, n), column(report.sigma_bearing_rad, n)
    sigma = np.where(np.isnan(sigma), properties.sigma_bearing_rad or np.nan, sigma)
    index = np.flatnonzero(np.isfinite(bearing + sigma))
    offset = np.nan_to_num(column(report.time_offset_s, n))[index]
    turned = bearing[index] + axes.turn_rad
    return _Taken(bearings(axes.place_m(), turned, sigma[index], offset), index)


def _farthest_m(view: View, measured: Measurement) -> float:
    """How far plots come from."""
    found = measured.found()
    if found is None or not measured.size:
        return MOST_REACH_M
    return max(float(np.hypot(*(found.place_m - view.site_m[:, None])).max()), LEAST_REACH_M)


def _view(properties: SourceProperties, axes: Placed) -> View:
    """Where a source can see, in the picture."""
    sector = properties.sector
    start, width = (sector.start_rad, sector.width_rad) if sector else (0.0, 2 * np.pi)
    reach = min(properties.range_max_m, MOST_REACH_M)
    return View(axes.place_m(), properties.range_min_m, reach, start + axes.turn_rad, width)
