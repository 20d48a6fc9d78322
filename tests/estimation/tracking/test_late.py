"""Late events: any order of arrival gives the state of the right order, within bounds of memory."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimation.tracking.late import History, Rules, begun, taken

State = tuple[int, ...]
Event = tuple[int, int]
WINDOW = 20


def rules(every: int = 1, memory: int = 10**9) -> Rules[State, Event]:
    """The state is the list of all events in the order in which they were folded."""
    return Rules(
        step=lambda state, event: (*state, event[0] * 1000 + event[1]),
        key=lambda event: event,
        size=lambda state: 100,
        window_ns=WINDOW,
        every=every,
        memory=memory,
    )


def start(given_rules: Rules[State, Event]) -> History[State, Event]:
    return begun((), given_rules, 0)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 60), st.integers(0, 5)), unique=True, max_size=40),
    st.randoms(use_true_random=False),
    st.integers(1, 7),
    st.integers(1, 5),
)
def test_any_order_within_the_window_gives_the_same_state(
    events: list[Event], random: object, every: int, together: int
) -> None:
    """Delays below the window, arrivals in groups, snapshots as rare as you like."""
    delay = {event: random.uniform(0, WINDOW - 1) for event in events}  # type: ignore[attr-defined]
    order = sorted(events, key=lambda event: event[0] + delay[event])
    the_rules = rules(every)
    history, refused = start(the_rules), 0
    for k in range(0, len(order), together):
        history, effort = taken(history, order[k : k + together], the_rules)
        refused += len(effort.refused)
    assert refused == 0
    assert history.state == tuple(t * 1000 + k for t, k in sorted(events))


def test_what_is_too_old_is_named_and_never_folded() -> None:
    history, _ = taken(start(rules()), [(10, 0), (50, 0)], rules())
    history, effort = taken(history, [(29, 0), (30, 0)], rules())
    assert effort.refused == ((29, 0),)
    assert history.state == (10_000, 30_000, 50_000)
    assert taken(history, [(29, 0)], rules())[0] is history


def test_what_comes_twice_counts_once() -> None:
    history, effort = taken(start(rules()), [(5, 0), (5, 0), (6, 0)], rules())
    assert effort.repeated == ((5, 0),)
    history, effort = taken(history, [(6, 0)], rules())
    assert (effort.repeated, effort.steps, history.state) == (((6, 0),), 0, (5000, 6000))


def test_in_order_nothing_is_replayed_and_late_only_what_follows() -> None:
    history = start(rules())
    for t in range(10):
        history, effort = taken(history, [(2 * t, 0)], rules())
        assert (effort.steps, effort.replayed) == (1, 0)
    _, effort = taken(history, [(13, 0)], rules())
    assert (effort.steps, effort.replayed) == (4, 3)


@pytest.mark.parametrize("every", [1, 4, 9])
def test_snapshots_are_as_rare_as_asked_and_bound_what_is_replayed(every: int) -> None:
    the_rules = rules(every)
    history = start(the_rules)
    for t in range(60):
        history, effort = taken(history, [(t, 0)], the_rules)
        assert effort.steps == 1
        inner = np.diff([snapshot.events for snapshot in history.snapshots])[:-1]
        assert (inner >= every).all()
    _, effort = taken(history, [(45, 1)], the_rules)
    assert effort.replayed <= 60 - 45 + every


def test_memory_is_bounded_and_the_state_is_the_same() -> None:
    """Room for six snapshots: as rare as it takes, and never fewer than two."""
    tight, wide = rules(memory=600), rules()
    order = np.argsort(np.arange(200) + np.random.default_rng(1).uniform(0, 19, 200))
    histories = [start(tight), start(wide)]
    for k in order:
        histories = [
            taken(h, [(int(k), 0)], r)[0] for h, r in zip(histories, (tight, wide), strict=True)
        ]
        assert len(histories[0].snapshots) <= 6
        assert len(histories[1].events) <= 2 * WINDOW + 2
    assert histories[0].state == histories[1].state == tuple(1000 * k for k in range(200))


def test_a_history_is_never_changed_in_place() -> None:
    before, _ = taken(start(rules()), [(1, 0), (3, 0)], rules())
    copy = History(*before)
    taken(before, [(2, 0)], rules())
    assert before == copy
