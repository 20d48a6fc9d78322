"""The ledger: nothing counts twice, in whatever portions it comes."""

from __future__ import annotations

import numpy as np

from estimation.ledger import EMPTY_LEDGER, counted, forgotten


def test_an_increment_may_be_lost_but_not_counted_twice() -> None:
    key = np.array([7, 7, 7, 9, 7, 9])
    begin = np.array([0, 0, 10, 5, 15, 5])
    end = np.array([10, 10, 20, 8, 25, 5])
    fresh, ledger = counted(EMPTY_LEDGER, key, begin, end)
    assert fresh.tolist() == [True, False, True, True, False, False]
    assert ledger.key.tolist() == [7, 9]
    assert ledger.until_ns.tolist() == [20, 8]
    fresh, ledger = counted(
        ledger, np.array([7, 9, 7]), np.array([10, 8, 40]), np.array([20, 9, 50])
    )
    assert fresh.tolist() == [False, True, True]  # the hole from 20 to 40 is only lost
    assert forgotten(ledger, 30).key.tolist() == [7]


def test_portions_do_not_matter() -> None:
    """Intervals in order of their ends, in one call or one by one, leave the same ledger."""
    rng = np.random.default_rng(1)
    key, begin = rng.integers(0, 5, 60), rng.integers(0, 500, 60)
    end = begin + rng.integers(1, 30, 60)
    order = np.lexsort((begin, end))
    fresh, together = counted(EMPTY_LEDGER, key[order], begin[order], end[order])
    ledger = EMPTY_LEDGER
    for n, k in enumerate(order):
        which = slice(k, k + 1)
        once, ledger = counted(ledger, key[which], begin[which], end[which])
        assert once[0] == fresh[n]
    assert [column.tolist() for column in ledger] == [column.tolist() for column in together]


def test_what_is_counted_never_overlaps() -> None:
    rng = np.random.default_rng(2)
    key, begin = rng.integers(0, 3, 200), rng.integers(0, 1000, 200)
    end = begin + rng.integers(-3, 40, 200)
    fresh, _ = counted(EMPTY_LEDGER, key, begin, end)
    assert 10 < fresh.sum() < 150
    for name in range(3):
        which = fresh & (key == name)
        order = np.argsort(begin[which])
        assert (end[which][order][:-1] <= begin[which][order][1:]).all()
        assert (begin[which] < end[which]).all()
