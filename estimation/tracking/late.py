"""Events that come late: the state is rolled back to before them and what followed is replayed.

A state may be anything that is never changed in place, so a snapshot costs a reference. The state
after a set of events is the fold of `step` over them by key and nothing else, hence the same to
the bit for every order of arrival; how far back an event may lie is the window.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable
from typing import Any, Generic, NamedTuple, TypeVar

State = TypeVar("State")
Event = TypeVar("Event")
Key = tuple[Any, ...]


class Rules(NamedTuple, Generic[State, Event]):
    """How events are folded and how much is kept.

    Attributes:
        step: the state after one more event.
        key: orders events, unique to each; its first item is the instant [ns].
        size: bytes a snapshot of a state holds.
        window_ns: how far before the newest event another may lie.
        every: events between snapshots, while memory allows.
        memory: bytes that snapshots may hold together; the oldest and the newest are kept anyway.
    """

    step: Callable[[State, Event], State]
    key: Callable[[Event], Key]
    size: Callable[[State], int]
    window_ns: int
    every: int = 1
    memory: int = 256 * 2**20


class Snapshot(NamedTuple, Generic[State]):
    """The state after the first `events` events of the history."""

    events: int
    state: State
    size: int


class History(NamedTuple, Generic[State, Event]):
    """A state and what is needed to put in what comes late; never changed in place.

    Attributes:
        events: those after the oldest snapshot, by key; keys: theirs.
        snapshots: by number of events, from 0 to all.
        settled_ns: events before this instant are no longer taken.
    """

    events: tuple[Event, ...]
    keys: tuple[Key, ...]
    snapshots: tuple[Snapshot[State], ...]
    settled_ns: int

    @property
    def state(self) -> State:
        """After all events."""
        return self.snapshots[-1].state


class Effort(NamedTuple, Generic[Event]):
    """What taking some events cost.

    Attributes:
        steps: made; replayed: of them, those of events that had been folded before.
        refused: events older than the window.
        repeated: events that were here already.
    """

    steps: int
    replayed: int
    refused: tuple[Event, ...]
    repeated: tuple[Event, ...]


def begun(state: State, rules: Rules[State, Event], settled_ns: int) -> History[State, Event]:
    """A history without events; none before `settled_ns` will be taken."""
    return History((), (), (Snapshot(0, state, rules.size(state)),), settled_ns)


def taken(
    history: History[State, Event], arrived: Iterable[Event], rules: Rules[State, Event]
) -> tuple[History[State, Event], Effort[Event]]:
    """The history with more events, in whatever order they come.

    Those that arrive together are replayed over once, however late each of them is.
    """
    new, refused, repeated = _sorted_out(history, arrived, rules)
    if not new:
        return history, Effort(0, 0, refused, repeated)
    first = bisect_left(history.keys, rules.key(new[0]))
    later = sorted([*history.events[first:], *new], key=rules.key)
    events = (*history.events[:first], *later)
    keys = tuple(rules.key(event) for event in events)
    kept = tuple(s for s in history.snapshots if s.events <= first)
    snapshots = _folded(kept, events, rules)
    steps = len(events) - kept[-1].events
    settled_ns = max(history.settled_ns, keys[-1][0] - rules.window_ns)
    whole = History(events, keys, snapshots, settled_ns)
    return _shortened(whole, rules), Effort(steps, steps - len(new), refused, repeated)


def _sorted_out(
    history: History[State, Event], arrived: Iterable[Event], rules: Rules[State, Event]
) -> tuple[list[Event], tuple[Event, ...], tuple[Event, ...]]:
    """Events to take by key, events too old, events here already."""
    known = set(history.keys)
    new, refused, repeated = [], [], []
    for event in sorted(arrived, key=rules.key):
        key = rules.key(event)
        if key in known:
            repeated.append(event)
        elif key[0] < history.settled_ns:
            refused.append(event)
        else:
            known.add(key)
            new.append(event)
    return new, tuple(refused), tuple(repeated)


def _folded(
    kept: tuple[Snapshot[State], ...], events: tuple[Event, ...], rules: Rules[State, Event]
) -> tuple[Snapshot[State], ...]:
    """The snapshots with those of the events after the last of them."""
    snapshots, state = list(kept), kept[-1].state
    for done in range(kept[-1].events + 1, len(events) + 1):
        state = rules.step(state, events[done - 1])
        if done == len(events) or done - snapshots[-1].events >= rules.every:
            snapshots.append(Snapshot(done, state, rules.size(state)))
    return _spaced(snapshots, rules.every)


def _spaced(snapshots: list[Snapshot[State]], every: int) -> tuple[Snapshot[State], ...]:
    """Those at least `every` events apart, the oldest and the newest in any case."""
    chosen = snapshots[:1]
    for snapshot in snapshots[1:-1]:
        if snapshot.events - chosen[-1].events >= every:
            chosen.append(snapshot)
    return (*chosen, snapshots[-1]) if len(snapshots) > 1 else tuple(chosen)


def _shortened(history: History[State, Event], rules: Rules[State, Event]) -> History[State, Event]:
    """Without what no event within the window can need, nor more snapshots than memory holds.

    A snapshot is of use to every event not before the last one it folds.
    """
    settled = bisect_left(history.keys, (history.settled_ns,))
    base = max(s.events for s in history.snapshots if s.events <= settled)
    snapshots = tuple(
        s._replace(events=s.events - base) for s in history.snapshots if s.events >= base
    )
    return history._replace(
        events=history.events[base:],
        keys=history.keys[base:],
        snapshots=_thinned(snapshots, rules.memory),
    )


def _thinned(snapshots: tuple[Snapshot[State], ...], memory: int) -> tuple[Snapshot[State], ...]:
    """Every second one given up until the rest fits, the oldest and the newest kept."""
    while len(snapshots) > 2 and sum(s.size for s in snapshots) > memory:
        snapshots = (*snapshots[:-1:2], snapshots[-1])
    return snapshots
