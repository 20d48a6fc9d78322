"""Laws of the ledger: every number is accounted for once, in any order."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from schemas.bus.ledger import Ledger, Seen, StreamKey

KEY = StreamKey("alpha", "boot", "radar")
ARRIVALS = st.lists(st.integers(min_value=1, max_value=40), max_size=120)


@given(ARRIVALS)
def test_each_number_is_new_exactly_once_and_gaps_are_what_never_came(arrivals: list[int]) -> None:
    ledger = Ledger()
    new = [seq for seq in arrivals if ledger.note(KEY, seq) is Seen.NEW]
    assert sorted(new) == sorted(set(arrivals))
    last = max(arrivals, default=0)
    missing = [s for first, end in ledger.missing(KEY, last) for s in range(first, end + 1)]
    assert missing == sorted(set(range(1, last + 1)) - set(arrivals))
    assert ledger.highest(KEY) == last
    assert ledger.through(KEY) == (missing[0] - 1 if missing else last)


@given(ARRIVALS, st.integers(1, 40), st.integers(0, 10))
def test_what_is_given_up_leaves_no_gap_and_is_late_when_it_comes(
    arrivals: list[int], first: int, length: int
) -> None:
    ledger = Ledger()
    for seq in arrivals:
        ledger.note(KEY, seq)
    ledger.give_up(KEY, first, first + length)
    for seq in range(first, first + length + 1):
        assert ledger.note(KEY, seq) is (Seen.DUPLICATE if seq in arrivals else Seen.LATE)
        assert ledger.note(KEY, seq) is Seen.DUPLICATE


def test_gaps_are_listed_for_every_stream_below_what_has_come() -> None:
    ledger = Ledger()
    other = KEY._replace(stream="ais")
    for key, seq in ((KEY, 1), (KEY, 4), (KEY, 6), (other, 2)):
        ledger.note(key, seq)
    assert list(ledger.gaps()) == [(KEY, 2, 3), (KEY, 5, 5), (other, 1, 1)]
    assert ledger.streams() == [KEY, other]


def test_a_long_stream_in_order_keeps_nothing() -> None:
    ledger = Ledger()
    for seq in range(1, 10_001):
        ledger.note(KEY, seq)
    assert ledger.through(KEY) == 10_000
    assert not list(ledger.gaps())


def test_a_seq_out_of_this_world_costs_nothing() -> None:
    ledger = Ledger()
    assert ledger.note(KEY, 1) is Seen.NEW
    assert ledger.note(KEY, 2**62) is Seen.NEW
    assert list(ledger.gaps()) == [(KEY, 2, 2**62 - 1)]
    assert ledger.missing(KEY, 2**63 - 1) == [(2, 2**62 - 1), (2**62 + 1, 2**63 - 1)]
    ledger.give_up(KEY, 2, 2**62 - 1)
    assert ledger.through(KEY) == 2**62
    assert ledger.note(KEY, 12345) is Seen.LATE


def test_more_gaps_than_can_be_remembered_are_refused_until_some_are_closed() -> None:
    ledger = Ledger(max_spans=10)
    told = [ledger.note(KEY, seq) for seq in range(2, 40, 2)]
    assert told == [Seen.NEW] * 10 + [Seen.REFUSED] * 9
    assert ledger.highest(KEY) == 20
    assert ledger.note(KEY, 3) is Seen.NEW
    assert ledger.note(KEY, 40) is Seen.NEW


def test_a_forgotten_stream_begins_anew() -> None:
    ledger = Ledger()
    ledger.note(KEY, 5)
    ledger.forget(KEY)
    assert ledger.streams() == []
    assert ledger.note(KEY, 5) is Seen.NEW


def test_what_goes_on_is_accounted_for_and_nothing_else() -> None:
    ledger = Ledger()
    key = StreamKey("alpha", "b1", "radar")
    goes_on = ledger.follower(key)
    assert not goes_on(1)
    assert ledger.note(key, 1) is Seen.NEW
    assert goes_on(2)
    for seq in (1, 2, 4):
        assert not goes_on(seq)
    assert ledger.note(key, 2) is Seen.DUPLICATE
    assert ledger.missing(key, 4) == [(3, 4)]
    ledger.give_up(key, 3, 3)
    assert goes_on(4)
    assert ledger.note(key, 3) is Seen.LATE
