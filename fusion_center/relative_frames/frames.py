"""The frames that are followed: carried from event to event, found anew, forgotten.

The estimates are `estimation.relative_frame.joint`; here they meet what carriers say of their own
way: how far they reckon to have come, which way they are turned, how much their norths wander.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.frames import wrap_pi
from estimation.relative_frame import OwnAxesFrame
from estimation.relative_frame.joint import Elapsed, JointFrames, carried_on, own_alone
from estimation.relative_frame.range_errors import NO_RANGE_ERRORS, RangeErrors, declared
from schemas.messages import SourceProperties

from ..navigation import NS, frame_covariance, way_m
from ..state import Frames, State

_BY_TURN = 0.5
"""Memories that pass with a radian of turn: the log's error turns with the bow, the current not."""


class Stand(NamedTuple):
    """How a carrier stands by its own navigation at an instant."""

    way_m: Array
    heading_rad: float
    north_variance: float
    sigma_drift_mps: float
    range_sigmas: tuple[float, float]


def stand(state: State, name: str, t_ns: int) -> Stand:
    """How a carrier stands; it must have navigation and a stated covariance."""
    navigation = state.carriers[name].navigation
    newest = navigation[-1]
    covariance = frame_covariance(newest.pose, state.declared(name))
    return Stand(
        way_m=way_m(navigation, t_ns),
        heading_rad=newest.pose.heading_rad,
        north_variance=0.0 if covariance is None else float(covariance[2, 2]),
        sigma_drift_mps=newest.sigma_speed_mps or state.settings.navigation.sigma_speed_mps,
        range_sigmas=_range_sigmas(state, name),
    )


def _range_sigmas(state: State, name: str) -> tuple[float, float]:
    """Prior sigmas of the bias and the scale that are sought of a carrier's ranges."""
    source = ranging_source(state, name)
    properties = state.sources(name).get(source, SourceProperties())
    return properties.sigma_range_bias_m, properties.sigma_range_scale


def ranging_source(state: State, name: str) -> str:
    """The one source of a carrier that measures ranges; empty where none does, or several do."""
    ranging = [s for s, p in state.sources(name).items() if p.coordinates != "bearing"]
    return ranging[0] if len(ranging) == 1 else ""


def range_errors(state: State, frames: Frames | None, name: str, source: str) -> RangeErrors:
    """What is to be added to the ranges of a source, as far as anybody knows."""
    properties = state.sources(name).get(source, SourceProperties())
    if properties.coordinates == "bearing":
        return NO_RANGE_ERRORS
    known = frames is not None and (name == state.own or name in frames.carriers)
    if frames is not None and known and source == ranging_source(state, name):
        return joint(frames).ranges(0 if name == state.own else row(frames, name))
    return declared(properties.sigma_range_bias_m, properties.sigma_range_scale)


def carried_to(state: State, t_ns: int) -> Frames | None:
    """The frames at an instant; None where none is followed."""
    frames = state.frames
    if frames is None or t_ns <= frames.t_ns:
        return frames
    stands = [stand(state, name, t_ns) for name in (state.own, *frames.carriers)]
    seconds = (t_ns - frames.t_ns) * NS
    settings = state.settings.registration
    headings = np.array([s.heading_rad for s in stands])
    turned = np.abs(wrap_pi(headings - frames.heading_rad))
    variances = np.array([s.north_variance for s in stands])
    wandered = np.maximum(variances - frames.north_variance, 0.0)
    elapsed = Elapsed(
        seconds=seconds,
        travel_m=np.array([s.way_m for s in stands]) - frames.way_m,
        kept=np.exp(-seconds / settings.drift_memory_s - _BY_TURN * turned),
        sigma_drift_mps=np.array([s.sigma_drift_mps for s in stands]),
        wandered_m=np.full(len(stands), settings.drift_m_per_root_s * np.sqrt(seconds)),
        wandered_rad=np.sqrt(wandered + settings.drift_rad_per_root_s**2 * seconds),
    )
    after = carried_on(joint(frames), elapsed)
    return _stored(frames.carriers, after, stands, t_ns)


def joint(frames: Frames) -> JointFrames:
    """The frames as `estimation` has them."""
    return JointFrames(frames.mean, frames.covariance)


def improved(frames: Frames, better: JointFrames) -> Frames:
    """The same carriers at the same instant, better known."""
    return replace(frames, mean=better.mean, covariance=_symmetric(better.covariance))


def joined_by(
    state: State,
    frames: Frames | None,
    name: str,
    frame: OwnAxesFrame,
    t_ns: int,
    through: tuple[str, Array | None],
    shared: Array | None = None,
) -> Frames:
    """The frames with a carrier's that has been found, for the first time or anew.

    Args:
        frame: in the axes of the carrier `through`, which is the own one or is followed.
        through: its name, and by what the frame hangs on range errors, see `considered`.
        shared: what it has in common with those that are followed, see `common_tracks`.
    """
    base, by_ranges = through
    own = stand(state, state.own, t_ns)
    if frames is None:
        alone = own_alone(own.sigma_drift_mps, *own.range_sigmas)
        frames = _stored((), alone, [own], t_ns)
    before, new = joint(frames), stand(state, name, t_ns)
    sigmas = new.sigma_drift_mps, *new.range_sigmas
    if base == state.own and by_ranges is None:
        after = before.joined_by(frame, *sigmas, shared)
    else:
        number = 0 if base == state.own else row(frames, base)
        after = before.joined_through(number, frame, *sigmas, by_ranges, shared)
    return replace(
        improved(frames, after),
        carriers=(*frames.carriers, name),
        way_m=np.vstack([frames.way_m, new.way_m]),
        heading_rad=np.append(frames.heading_rad, new.heading_rad),
        north_variance=np.append(frames.north_variance, new.north_variance),
    )


def row(frames: Frames, name: str) -> int:
    """Which row is a carrier's; the own carrier's is 0."""
    return frames.carriers.index(name) + 1


def frame_of(frames: Frames, name: str) -> OwnAxesFrame:
    """One carrier's frame."""
    return joint(frames).frame(row(frames, name))


def _stored(
    carriers: tuple[str, ...], found: JointFrames, stands: Sequence[Stand], t_ns: int
) -> Frames:
    return Frames(
        t_ns=t_ns,
        carriers=carriers,
        mean=found.mean,
        covariance=_symmetric(found.covariance),
        way_m=np.array([s.way_m for s in stands]),
        heading_rad=np.array([s.heading_rad for s in stands]),
        north_variance=np.array([s.north_variance for s in stands]),
    )


def _symmetric(covariance: Array) -> Array:
    """Rounding would else grow from step to step."""
    symmetric: Array = (covariance + covariance.T) / 2
    return symmetric
