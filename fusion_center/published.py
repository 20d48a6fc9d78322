"""What a Closed gives out: corrections, tracks, association, alignment, quality, in this order.

A Correction of every other carrier is published with every Closed. Where there was no report event
it repeats the last one; `valid_t_ns` says for when it holds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

from msgspec.structs import replace

from schemas import keys
from schemas.feedback import correction_id
from schemas.messages import (
    Alignment,
    Association,
    Closed,
    Correction,
    Output,
    Quality,
    Tracks,
)

from .group import chosen
from .group import filtering as group
from .group.published import beacons_told, carriers_told
from .passive import lines as passive_lines
from .picture import shown
from .quality import Tally
from .relative_frames import feedback
from .relative_frames.monitor import sentence
from .state import State
from .timeline import Batch


class Published(NamedTuple):
    """An output and where it goes: `topic.key(run, *ids)`."""

    topic: keys.Topic
    ids: tuple[str, ...]
    message: Output


Outputs = list[Published]


class _Planned(NamedTuple):
    """An output to be made, once it has its number."""

    topic: keys.Topic
    ids: tuple[str, ...]
    make: Callable[[int], Output]


def published(state: State, closed: Closed, batch: Batch, tally: Tally) -> tuple[State, Outputs]:
    """The outputs of a Closed, numbered by their keys."""
    numbers, outputs = dict(state.published), []
    for topic, ids, make in _planned(state, closed, batch, tally):
        name = "/".join((topic.name, *ids))
        numbers[name] = numbers.get(name, 0) + 1
        outputs.append(Published(topic, ids, make(numbers[name])))
    return replace(state, published=numbers), outputs


def _planned(state: State, closed: Closed, batch: Batch, tally: Tally) -> Iterator[_Planned]:
    """What is published, in order."""
    here = (state.centre,)
    for carrier in sorted(state.links):
        correction = partial(_correction, state, closed, carrier)
        yield _Planned(keys.CORRECTION, (state.centre, carrier), correction)
    yield _Planned(keys.TRACK, here, partial(_tracks, state, closed))
    yield _Planned(keys.ASSOCIATION, here, partial(_association, state, closed, tally))
    if group.is_wanted(state):
        yield _Planned(keys.ALIGNMENT, here, partial(_alignment, state, closed))
    yield _Planned(keys.QUALITY, here, partial(_quality, state, closed, batch, tally))


def _tracks(state: State, closed: Closed, seq: int) -> Tracks:
    """The picture, and what bearings alone say."""
    told = shown.at_closing(state, closed.t_ns)
    return Tracks(
        centre=state.centre,
        seq=seq,
        step=closed.step,
        t_ns=closed.t_ns,
        objects=told.objects.mean,
        sigma_objects=told.objects.sigma,
        tracks=told.tracks,
        lines=passive_lines.lines(state, closed.t_ns),
    )


def _association(state: State, closed: Closed, tally: Tally, seq: int) -> Association:
    """Which logs of a Closed belong together."""
    return Association(
        centre=state.centre,
        seq=seq,
        step=closed.step,
        t_ns=closed.t_ns,
        targets=tally.targets(),
        alone=tally.alone(),
    )


def _quality(state: State, closed: Closed, batch: Batch, tally: Tally, seq: int) -> Quality:
    """How well what was said agrees, and what was not fused."""
    return Quality(
        centre=state.centre,
        seq=seq,
        step=closed.step,
        t_ns=closed.t_ns,
        sources=tally.sources(),
        late=batch.late_count,
        gave_up=batch.gave_up_count,
        messages=batch.fused,
    )


def _alignment(state: State, closed: Closed, seq: int) -> Alignment:
    """Beacons, and the carriers that range to them and to each other, as known at a closing."""
    return Alignment(
        centre=state.centre,
        seq=seq,
        step=closed.step,
        t_ns=closed.t_ns,
        beacons=beacons_told(state),
        carriers=carriers_told(state),
    )


def _correction(state: State, closed: Closed, carrier: str, seq: int) -> Correction:
    """Where a carrier's frame lies, as far as it is known at a closing."""
    monitor, estimate = chosen.status(state, carrier, closed.t_ns)
    blank = Correction(
        centre=state.centre,
        seq=seq,
        step=closed.step,
        t_ns=closed.t_ns,
        carrier=carrier,
        id=correction_id(state.centre, carrier, closed.step),
        state=monitor.state,
        reason=monitor.reason[:1024],
    )
    if estimate is None:
        return blank
    wander = max(feedback.wander_m2_s(state, carrier) + estimate.spreads_m2_s, 0.0)
    return replace(
        blank,
        valid_t_ns=estimate.valid_t_ns,
        since_t_ns=estimate.since_t_ns,
        valid_for_s=estimate.valid_for_s,
        own_pose=estimate.own_pose,
        other_pose=estimate.other_pose,
        own_axes=estimate.own_axes,
        fixed_axes=estimate.fixed_axes,
        directions=list(estimate.directions),
        weakest=sentence(estimate.directions[0]),
        pairs=estimate.pairs,
        chi2=estimate.chi2,
        dof=estimate.dof,
        method=estimate.method,
        mode_probability=estimate.mode_probability,
        terms=list(estimate.terms),
        feedback=feedback.of(estimate, wander) if monitor.state == "applied" else None,
    )
