"""Nothing counts twice: which intervals of what each source says are already in the picture.

An increment of a track holds what its filter learnt from one report to the next; a plot of the same
source, what it saw since the plot before; a class that a source names over and over, one opinion
for as long as its memory lasts. Each is an interval of a key, entered once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Ledger(NamedTuple):
    """Up to when everything has been counted, as columns sorted by key.

    Attributes:
        key: (n,) a number for good for whatever must not count twice.
        until_ns: (n,) end of the last interval counted.
    """

    key: NDArray[np.int64]
    until_ns: NDArray[np.int64]


EMPTY_LEDGER = Ledger(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64))
"""Nothing counted yet."""


def counted(
    ledger: Ledger,
    key: NDArray[np.int64],
    begin_ns: NDArray[np.int64],
    end_ns: NDArray[np.int64],
) -> tuple[NDArray[np.bool_], Ledger]:
    """Which intervals (begin, end] are news, and the ledger with those entered.

    An interval that begins before the last one of its key ended holds something that was counted
    already, and is refused as a whole; a hole between two is lost information and does no harm.

    Args:
        ledger: so far.
        key: (K,) of what each is of.
        begin_ns: (K,) since when it says something; end_ns: until when.
    """
    until = dict(zip(ledger.key.tolist(), ledger.until_ns.tolist(), strict=True))
    fresh = np.zeros(len(key), dtype=np.bool_)
    for k in np.lexsort((begin_ns, end_ns)).tolist():
        name, begin, end = int(key[k]), int(begin_ns[k]), int(end_ns[k])
        fresh[k] = begin < end and until.get(name, begin) <= begin
        if fresh[k]:
            until[name] = end
    keys = np.array(sorted(until), dtype=np.int64)
    ends = np.array([until[name] for name in keys.tolist()], dtype=np.int64)
    return fresh, Ledger(keys, ends)


def forgotten(ledger: Ledger, before_ns: int) -> Ledger:
    """The ledger without what ended before an instant that no report can reach back to."""
    kept = ledger.until_ns >= before_ns
    return Ledger(ledger.key[kept], ledger.until_ns[kept])
