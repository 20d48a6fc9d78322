"""What carriers see at one instant, by their tracks: places, velocities, and the plots behind them.

A track's place is surest, but its errors last from instant to instant. Whoever follows frames over
time therefore uses each plot once, carried to the instant by the velocity of its track.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from dataclasses import replace as with_fields
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.frames import on_surface, rotation_clockwise, yaw_rad
from estimation.relative_frame.range_errors import RangeErrors
from estimation.tracking.bank import Bank, carried
from schemas.messages import SourceProperties

from ..navigation import NS, site, way_m
from ..sources.sightings import Sightings
from ..sources.telling import refitted, run_dictionary
from ..sources.tracks import NAMELESS
from ..state import CarrierState, SourceLogs, State
from .corrections import Poses
from .registration import LEAST_RANGE_M


@dataclass(frozen=True, eq=False, slots=True)
class View(Sightings):
    """Tracks of one carrier at one instant, by their filters; n of them.

    Attributes:
        velocity_mps: (n, 2) over ground; velocity_covariance: (n, 2, 2).
        plot_m: (n, 2) the newest plot, carried to the instant; plot_covariance: (n, 2, 2).
        ready: (n,) whether that plot has not served yet and may.
    """

    velocity_mps: Array
    velocity_covariance: Array
    plot_m: Array
    plot_covariance: Array
    ready: NDArray[np.bool_]

    def take(self, which: NDArray[np.intp]) -> View:
        """Some of them."""
        columns = (getattr(self, field.name) for field in fields(self))
        return View(*(_taken(column, which) for column in columns))


def _taken(column: Any, which: NDArray[np.intp]) -> Any:
    if isinstance(column, np.ndarray):
        return column[which]
    return tuple(column[i] for i in which)


def view(state: State, name: str, t_ns: int) -> View:
    """The confirmed tracks of a carrier, relative to where it believes to be at the instant."""
    carrier = state.carriers[name]
    way = way_m(carrier.navigation, t_ns)
    declared = state.declared(name)
    sources = state.sources(name)
    parts = [
        _of_source(
            state,
            (name, source),
            t_ns,
            sources.get(source, SourceProperties()),
            declared.sigma_clock_s if declared else 0.0,
        )
        for source in sorted(carrier.logs)
    ]
    whole = _joined(parts)
    return with_fields(whole, east_north_m=whole.east_north_m - way, plot_m=whole.plot_m - way)


@np.errstate(all="ignore")  # numbers from the wire may be anything within its bounds
def _of_source(
    state: State,
    address: tuple[str, str],
    t_ns: int,
    properties: SourceProperties,
    sigma_clock_s: float,
) -> View:
    """The confirmed tracks of one source; places with the carrier's way in them."""
    name, source = address
    carrier, settings = state.carriers[name], state.settings
    logs = carrier.logs[source]
    which = _confirmed(state, logs, t_ns)
    after_s = (t_ns - logs.t_ns[0, which]) * NS
    bank = Bank(logs.state[which], logs.state_covariance[which])
    bank = carried(bank, after_s, settings.tracking.process_noise_m2ps3)
    rates = bank.state[:, 2:]
    spread = bank.covariance[:, 2:, 2:]
    timing_s = np.hypot(sigma_clock_s, properties.sigma_clock_s)
    blur = timing_s**2 * rates[:, :, None] * rates[:, None, :]
    walked = settings.tracking.process_noise_m2ps3 * np.abs(after_s) ** 3 / 3
    plot_covariance = logs.covariance[0, which] + (after_s**2)[:, None, None] * spread + blur
    plot_covariance = plot_covariance + walked[:, None, None] * np.eye(2)
    stream = f"{name}/{carrier.boot}/{source}/"
    return View(
        log=tuple(f"{stream}{logs.seq[i]}/{logs.index[i]}" for i in which),
        source=(source,) * len(which),
        fresh=tuple((logs.seq[which] == logs.report_seq).tolist()),
        identity=tuple(logs.identity[i] for i in which),
        track=tuple(f"{name}/{source}/{logs.track[i]}" if logs.track[i] else "" for i in which),
        east_north_m=bank.state[:, :2],
        covariance=bank.covariance[:, :2, :2] + blur,
        altitude_m=logs.altitude_m[which],
        features=refitted(logs.features[which], logs.dictionary, run_dictionary(state)),
        velocity_mps=rates,
        velocity_covariance=spread,
        plot_m=logs.place_m[0, which] + after_s[:, None] * rates,
        plot_covariance=plot_covariance,
        ready=_unused(logs)[which],
    )


def _unused(logs: SourceLogs) -> NDArray[np.bool_]:
    """(n,) whose newest log has not served."""
    return np.asarray(logs.t_ns[0] > logs.used_t_ns, dtype=np.bool_)


def _confirmed(state: State, logs: SourceLogs, t_ns: int) -> NDArray[np.intp]:
    """Tracks that are targets and young enough; names are believed at once."""
    log_settings, tracking = state.settings.logs, state.settings.tracking
    nameless = np.array([key[0] == NAMELESS for key in logs.key], dtype=np.bool_)
    sure = (logs.existence > tracking.confirm) & (logs.hits >= tracking.confirm_after)
    limit_s = np.where(logs.hits > 1, log_settings.max_age_s, log_settings.single_max_age_s)
    young = np.abs(t_ns - logs.t_ns[0]) * NS <= limit_s
    sane = np.isfinite(logs.state_covariance).all(axis=(1, 2))
    chosen: NDArray[np.intp] = np.flatnonzero(young & sane & (sure | ~nameless))
    return chosen


def _joined(parts: Sequence[View]) -> View:
    """All sources of a carrier, one after another."""
    if len(parts) == 1:
        return parts[0]
    columns: list[Any] = []
    for field in fields(View):
        values = [getattr(part, field.name) for part in parts] or [getattr(_NOTHING, field.name)]
        if isinstance(values[0], tuple):
            columns.append(tuple(item for value in values for item in value))
        else:
            columns.append(np.concatenate(values))
    return View(*columns)


_NOTHING = View(
    log=(),
    source=(),
    fresh=(),
    identity=(),
    track=(),
    east_north_m=np.zeros((0, 2)),
    covariance=np.zeros((0, 2, 2)),
    altitude_m=np.zeros(0),
    features=np.zeros((0, 0)),
    velocity_mps=np.zeros((0, 2)),
    velocity_covariance=np.zeros((0, 2, 2)),
    plot_m=np.zeros((0, 2)),
    plot_covariance=np.zeros((0, 2, 2)),
    ready=np.zeros(0, dtype=np.bool_),
)


@np.errstate(all="ignore")
def in_own_plane(seen: View, between: Poses | None) -> View:
    """A view along the axes of the own tangent plane, without what has no bearing or no number.

    Args:
        between: None for the own carrier, whose plane it is already.
    """
    if between is not None and seen.log:
        turn = rotation_clockwise(yaw_rad(between.own_from_other))
        seen = with_fields(
            seen,
            east_north_m=_carried_over(seen.east_north_m, seen.altitude_m, between),
            plot_m=_carried_over(seen.plot_m, seen.altitude_m, between),
            velocity_mps=seen.velocity_mps @ turn.T,
            covariance=turn @ seen.covariance @ turn.T,
            plot_covariance=turn @ seen.plot_covariance @ turn.T,
            velocity_covariance=turn @ seen.velocity_covariance @ turn.T,
        )
    clear = _is_clear(seen.east_north_m) & _is_clear(seen.plot_m)
    return seen if clear.all() else seen.take(np.flatnonzero(clear))


def _carried_over(places_m: Array, altitude_m: Array, between: Poses) -> Array:
    """Places in the other's tangent plane along the axes of the own one, see `registration`."""
    east, north = places_m.T
    enu = on_surface(site(between.other), east, north, altitude_m)
    over: Array = enu @ between.own_from_other.rotation[:2].T
    return over


def with_ranges(seen: View, errors: Mapping[str, RangeErrors], followed: str = "") -> View:
    """A view with what is known of its sources' range errors added, and what is open as noise.

    Args:
        seen: of one carrier, along any axes.
        errors: by source.
        followed: the source whose errors are states of the frames: its plots stay as measured.
    """
    for source, ranges in errors.items():
        if ranges.none or source not in seen.source:
            continue
        mine = np.array([name == source for name in seen.source])[:, None]
        places, plots = seen.east_north_m, seen.plot_m
        spread = np.where(mine[..., None], ranges.spread(places), 0.0)
        seen = with_fields(
            seen,
            east_north_m=places + np.where(mine, ranges.added(places), 0.0),
            covariance=seen.covariance + spread,
        )
        if source != followed:
            blur = np.where(mine[..., None], ranges.spread(plots), 0.0)
            seen = with_fields(seen, plot_covariance=seen.plot_covariance + blur)
    return seen


def _is_clear(places_m: Array) -> NDArray[np.bool_]:
    """(n,) whether a target stands clear of its carrier, and at a place on Earth."""
    away = np.hypot(*places_m.T)
    clear: NDArray[np.bool_] = (away > LEAST_RANGE_M) & (away < 1e7)
    return clear


def with_plots_used(state: State, names: Sequence[str]) -> State:
    """The state in which no plot of these carriers that is known by now will serve again."""
    carriers = dict(state.carriers)
    for name in names:
        carrier: CarrierState = carriers[name]
        logs = {source: _used(logs) for source, logs in carrier.logs.items()}
        carriers[name] = replace(carrier, logs=logs)
    return replace(state, carriers=carriers)


def _used(logs: SourceLogs) -> SourceLogs:
    return replace(logs, used_t_ns=np.where(_unused(logs), logs.t_ns[0], logs.used_t_ns))
