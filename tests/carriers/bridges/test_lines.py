"""Lines are the same whatever pieces they come in."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from carriers.bridges.feeds import Arrival
from carriers.bridges.lines import Lines


def split(pieces: list[bytes], max_bytes: int = 1000) -> list[bytes]:
    lines = Lines(max_bytes)
    arrivals = [*(Arrival(1, piece) for piece in pieces), Arrival(1, b"", ended=True)]
    return [line for arrival in arrivals for line in lines.split(arrival)]


@given(st.binary(max_size=200), st.lists(st.integers(0, 200), max_size=8), st.integers(1, 60))
def test_how_a_stream_is_cut_changes_nothing(data: bytes, cuts: list[int], longest: int) -> None:
    data = data.replace(b"\x00", b"\n")
    edges = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    pieces = [data[a:b] for a, b in itertools.pairwise(edges)]
    whole = [line[:longest] for line in data.split(b"\n") if line and not line.isspace()]
    assert split(pieces, longest) == whole


def test_every_connection_has_its_own_beginning_and_end() -> None:
    lines = Lines()
    assert lines.split(Arrival(1, b"one ")) == []
    assert lines.split(Arrival(2, b"two ")) == []
    assert lines.split(Arrival(1, b"is 1\nand")) == [b"one is 1"]
    assert lines.split(Arrival(1, b"", ended=True)) == [b"and"]
    assert lines.split(Arrival(2, b"is 2\n")) == [b"two is 2"]
    assert lines.split(Arrival(1, b"new\n")) == [b"new"]


def test_a_datagram_is_whole() -> None:
    lines = Lines()
    assert lines.split(Arrival(0, b"a\n\nb", whole=True)) == [b"a", b"b"]
    assert lines.split(Arrival(0, b"c", whole=True)) == [b"c"]


def test_a_line_that_never_ends_takes_bounded_memory_and_is_one_line() -> None:
    lines = Lines(100)
    found = [line for _ in range(50) for line in lines.split(Arrival(1, b"x" * 60))]
    assert found == [b"x" * 100]
    assert lines.split(Arrival(1, b"xx\nnext\n")) == [b"next"]
