"""What comes later than others of its time: back to before it, and on again with it in its place.

The messages of the last few seconds are kept, and the state before some of their instants. When an
instant is to be fused that lies before others fused already, the fusion starts again from the last
state kept before it. So the final state does not depend on the order of arrival within the window;
what lies before the window is late, and is counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from msgspec.structs import replace

from schemas import codec
from schemas.messages import Input, Navigation, Ranging, SourceInfo, SourceReport

from . import timeline
from .state import CarrierState, Link, Orders, Past, State, Timeline
from .timeline import BACK_NS, Instant

STATES = 32
"""States kept over the window, at most about so many."""
_KINDS: dict[str, type[Input]] = {
    kind.__name__: kind for kind in (Navigation, Ranging, SourceInfo, SourceReport)
}
_Name = tuple[str, str, str, int]


class Course(NamedTuple):
    """What is to be fused from which state on.

    Attributes:
        state: to start from.
        instants: in order; some of their messages may have been fused before.
        again: names of those messages.
        until_ns: last instant that had been fused; -1 = none.
    """

    state: State
    instants: list[Instant]
    again: frozenset[_Name]
    until_ns: int

    def is_new(self, message: Input) -> bool:
        """Whether a message is fused for the first time."""
        return name_of(message) not in self.again


def course(state: State, instants: Sequence[Instant]) -> Course:
    """How to fuse these instants: straight on, or from further back.

    What sources are is told without a time: it never leads back.
    """
    until = max((past.t_ns for past in state.past), default=-1)
    back = [instant for instant in instants if instant.t_ns <= until]
    told, back = _told_only(back)
    if not back:
        onwards = [instant for instant in instants if instant.t_ns > until]
        return Course(state, [*told, *onwards], frozenset(), until)
    first = _restart(state.past, back[0].t_ns)
    kept = [message for past in state.past[first:] for message in _messages(past)]
    again = frozenset(map(name_of, kept))
    new = [m for i in instants for m in i.messages if name_of(m) not in again]
    start = _restored(state, first)
    return Course(start, timeline.instants(state.timeline, [*kept, *new]), again, until)


def _told_only(instants: Sequence[Instant]) -> tuple[list[Instant], list[Instant]]:
    """What sources are, in instants of its own, and the instants with anything else."""
    told = [m for i in instants for m in i.messages if isinstance(m, SourceInfo)]
    rest = [i for i in instants if any(not isinstance(m, SourceInfo) for m in i.messages)]
    return [Instant(message.t_ns, [message]) for message in told if not rest], rest


def _restart(past: Sequence[Past], t_ns: int) -> int:
    """The last instant at or before `t_ns` with a state before it; else the first one."""
    return max((i for i, p in enumerate(past) if p.before and p.t_ns <= t_ns), default=0)


def _restored(state: State, first: int) -> State:
    """The state before an instant of the past, with all that does not come of messages as now."""
    before = state.past[first].before
    if before is None:
        return state
    carriers = {
        name: replace(before.carriers.get(name, CarrierState()), lost=now.lost)
        for name, now in state.carriers.items()
    }
    gone = {n for n, c in carriers.items() if c.lost and not before.carriers.get(n, c).lost}
    links = {
        name: Link() if name in gone or name not in before.links else before.links[name]
        for name in state.links
    }
    return replace(
        before,
        timeline=state.timeline,
        orders=state.orders,
        settings=state.settings,
        published=state.published,
        carriers=carriers,
        links=links,
        past=state.past[:first],
    )


def remembered(state: State, instant: Instant) -> State:
    """The state about to fuse an instant, which it will be able to come back to."""
    messages = tuple((type(m).__name__, codec.encode(m)) for m in instant.messages)
    told = all(isinstance(message, SourceInfo) for message in instant.messages)
    if told and state.past and instant.t_ns < state.past[-1].t_ns:
        return state
    kept = next((p.t_ns for p in reversed(state.past) if p.before), None)
    spaced = kept is None or instant.t_ns - kept >= _window_ns(state) // STATES
    before = _bare(state) if spaced else None
    past = Past(t_ns=instant.t_ns, before=before, messages=messages)
    return replace(state, past=(*state.past, past))


def _bare(state: State) -> State:
    """The state without what is taken from the present when it is come back to."""
    return replace(state, past=(), timeline=Timeline(), orders=Orders(), published={})


def settled(state: State) -> State:
    """The state without the past that nothing can lead back to."""
    earliest = state.timeline.t_ns - _window_ns(state)
    return replace(state, past=state.past[_restart(state.past, earliest) :])


def name_of(message: Input) -> _Name:
    """What no other message is called."""
    return message.carrier, message.boot, message.stream, message.seq


def _window_ns(state: State) -> int:
    return round(state.scenario.max_clock_error_s * 1e9) + BACK_NS


def _messages(past: Past) -> list[Input]:
    return [codec.decode(_KINDS[kind], payload) for kind, payload in past.messages]
