"""The queue between a bus and a process: bounded, exact in what it drops."""

from __future__ import annotations

import pytest

from schemas.bus.interface import Inbox

SIZES = [4, 3, 5, 1, 2, 9, 1]


class Told(Inbox[int]):
    """An inbox that remembers what it has dropped."""

    def __init__(self, max_bytes: int) -> None:
        super().__init__(max_bytes)
        self.lost: list[int] = []

    def on_drop(self, item: int) -> None:
        self.lost.append(item)


@pytest.mark.parametrize("max_bytes", [0, 7, 10, 24, 25])
def test_many_at_once_are_as_many_one_by_one(max_bytes: int) -> None:
    one_by_one, at_once = Told(max_bytes), Told(max_bytes)
    for number, size in enumerate(SIZES):
        one_by_one.put(number, size)
    at_once.put_all(range(len(SIZES)), SIZES)
    assert (at_once.lost, at_once.drops) == (one_by_one.lost, one_by_one.drops)
    assert at_once.bytes == one_by_one.bytes <= max_bytes
    assert at_once.take() == one_by_one.take()
    assert (at_once.bytes, len(at_once)) == (0, 0)
