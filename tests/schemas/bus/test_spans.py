"""Spans are a set of integers, whatever their number."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from schemas.bus.spans import Spans

EDGE = st.integers(1, 30)
CHANGES = st.lists(st.tuples(st.booleans(), EDGE, st.integers(-1, 8)), max_size=30)


@given(CHANGES, EDGE, EDGE)
def test_spans_hold_what_a_set_would(
    changes: list[tuple[bool, int, int]], first: int, last: int
) -> None:
    spans, numbers = Spans(), set[int]()
    for put_in, start, length in changes:
        if put_in:
            spans.add(start, start + length)
            numbers |= set(range(start, start + length + 1))
        else:
            spans.discard(start, start + length)
            numbers -= set(range(start, start + length + 1))
    assert {n for a, b in spans for n in range(a, b + 1)} == numbers
    assert [n in spans for n in range(45)] == [n in numbers for n in range(45)]
    assert spans.last == max(numbers, default=0)
    runs = list(spans)
    assert all(b + 1 < a for (_, b), (a, _) in itertools.pairwise(runs))
    assert len(spans) == len(runs)
    holes = {n for a, b in spans.holes(first, last) for n in range(a, b + 1)}
    assert holes == set(range(first, last + 1)) - numbers
    assert spans.touches(first) == bool(numbers & {first - 1, first, first + 1})


def test_long_spans_cost_no_more_than_short_ones() -> None:
    spans = Spans()
    spans.add(1, 2**62)
    spans.discard(2**61, 2**61)
    assert list(spans) == [(1, 2**61 - 1), (2**61 + 1, 2**62)]
    assert list(spans.holes(1, 2**63)) == [(2**61, 2**61), (2**62 + 1, 2**63)]
    spans.forget_first()
    assert 1 not in spans
