"""The fusion as one pure step: no bus, no clock, no randomness.

A Closed is fused instant by instant, in the order of the stamps. Reports of several carriers make a
*report event* (see `windows`, or `memoryless` for the baselines): frames are found or followed, at
one instant, from what was seen about it. So the estimates and their monitors depend on what was
said of which instant, and not on how time was cut into Closed messages. Messages that come in a
later Closed than younger ones already fused are put in their place, see `rollback`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from msgspec.structs import replace

from schemas import keys
from schemas.errors import SettingsError
from schemas.messages import Closed, DeclaredScenario, Event, Input, SourceReport

from . import rollback, timeline
from .group import filtering as group
from .orders import carry_out
from .passive import frames as passive_frames
from .passive import lines as passive_lines
from .picture import fusing as picture
from .published import Outputs, published
from .quality import Tally
from .relative_frames import joint, memoryless
from .rollback import Course
from .settings import Settings
from .sources.intake import absorb, out_of_order, take_part
from .sources.uncorrected import taken_out
from .state import State
from .timeline import Batch


class _Registrar(NamedTuple):
    """How frames are estimated: what is done before the messages of an instant, and after them."""

    before: Callable[[State, timeline.Instant, Tally], State]
    after: Callable[[State, Tally], State]


_MEMORYLESS = _Registrar(lambda state, instant, tally: state, memoryless.with_registrations)
_FRAMES = {
    "joint": _Registrar(joint.ended, joint.completed),
    "closed_form": _MEMORYLESS,
    "adjustment": _MEMORYLESS,
}


def initial(scenario: DeclaredScenario, settings: Settings, centre: str = keys.FUSION) -> State:
    """The state before the first Closed.

    Raises:
        SettingsError: the own carrier is not declared, or none is and `own` does not name one.
    """
    names = [carrier.name for carrier in scenario.carriers]
    own = settings.own or (names[0] if names else "")
    if not own or (names and own not in names):
        raise SettingsError(
            "no such carrier", where="own", got=own, expected=" or ".join(names) or "a carrier"
        )
    return State(centre=centre, own=own, scenario=scenario, settings=settings)


def step(state: State, closed: Closed, messages: Sequence[Input | Event]) -> tuple[State, Outputs]:
    """Fuse what one Closed names; nothing here knows of Zenoh or of the clock.

    Args:
        messages: at least what the Closed names, and the events of its step, in any order;
            whatever else is among them is left alone.

    Raises:
        ValueError: a message that the Closed names is missing.
    """
    # what counts, and who takes part
    error_s = state.scenario.max_clock_error_s
    now, batch = timeline.take(state.timeline, closed, messages, error_s)
    state = carry_out(replace(state, timeline=now), batch.events)
    state = take_part(state, closed)
    tally = _not_fused(batch, closed)
    for report in out_of_order(state, _reports(batch)):
        tally.disordered(report)
    batch = taken_out(batch, state.centre, closed.step, tally)

    # per-source tracks -> report events (frames: searched for, then followed together)
    # -> picture, and what bearings alone say -> the joint state of all that range
    course = rollback.course(state, batch.instants)
    state = course.state
    for instant in course.instants:
        state = _fused(rollback.remembered(state, instant), instant, course, tally)

    # what is known at the closing
    return published(rollback.settled(state), closed, batch, tally)


def _fused(state: State, instant: timeline.Instant, course: Course, tally: Tally) -> State:
    """The state after one instant; what is fused again is not counted again."""
    frames, silent = _FRAMES[state.settings.registration.method], Tally()
    news = instant.t_ns > course.until_ns or any(map(course.is_new, instant.messages))
    of_event = tally if news else silent

    def of(message: Input) -> Tally:
        return tally if course.is_new(message) else silent

    state = frames.before(state, instant, of_event)
    for message in instant.messages:
        state = absorb(state, message, of(message))
    state = passive_frames.with_bearings(frames.after(state, of_event), instant)
    state = picture.with_reports(state, instant, of)
    return group.with_messages(passive_lines.with_bearings(state, instant), instant, of)


def _reports(batch: Batch) -> Iterator[SourceReport]:
    """Those among what a Closed brings."""
    for instant in batch.instants:
        yield from (m for m in instant.messages if isinstance(m, SourceReport))


def _not_fused(batch: Batch, closed: Closed) -> Tally:
    """Begin to count, with what is too late or too early to be fused."""
    tally = Tally()
    for message in batch.late:
        tally.late(message)
    for message in batch.future:
        tally.future(message, (message.t_ns - closed.t_ns) * 1e-9)
    return tally
