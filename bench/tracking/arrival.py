"""Scans that arrive late and in any order: the same picture to the bit, and what that costs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimation.arrays import Indices
from estimation.tracking.late import History, Rules, begun, taken
from estimation.tracking.scan import Scan
from estimation.tracking.tracker import Picture, Settings, nothing, step

_WINDOW_NS = 3_000_000_000  # a clock error of 1 s and delays of 2 s
_DELAY_S = 2.0


class Cost(NamedTuple):
    """Of late arrival, against arrival in order."""

    identical: bool
    cpu: float
    steps: float
    memory_mib: float


def cost(scans: Sequence[Scan], settings: Settings, seed: int, repeats: int = 3) -> Cost:
    """Every scan delayed by 0 to 2 s at random; best CPU time of some repeats, taken in turns."""
    rng = np.random.default_rng([seed, 11])
    sent_s = np.array([scan.t_ns * 1e-9 for scan in scans])
    order = np.argsort(sent_s + rng.uniform(0.0, _DELAY_S, len(scans)), kind="stable")
    rules = rules_for(settings)
    both = [[_run(scans, which, rules, settings) for which in (np.arange(len(scans)), order)]]
    both += [
        [_run(scans, which, rules, settings) for which in (np.arange(len(scans)), order)]
        for _ in range(repeats - 1)
    ]
    in_order, late = (min(run.cpu_s for run in column) for column in zip(*both, strict=True))
    reference, shuffled = both[0]
    return Cost(
        same(reference.history.state, shuffled.history.state),
        late / in_order,
        shuffled.steps / reference.steps,
        shuffled.memory / 2**20,
    )


def rules_for(settings: Settings) -> Rules[Picture, Scan]:
    """Scans folded into a picture."""
    return Rules(
        step=lambda picture, scan: step(picture, scan, settings)[0],
        key=lambda scan: (scan.t_ns, *scan.view.site_m.tolist()),
        size=held,
        window_ns=_WINDOW_NS,
    )


def held(picture: Picture) -> int:
    """Bytes of the arrays of a picture."""
    tracks, unseen = picture.tracks, picture.undetected
    known = (tracks.classes, *tracks.features, tracks.aside)
    arrays = (tracks.identity, tracks.existence, *tracks.bank, *known, *unseen[1:])
    return sum(array.nbytes for array in arrays)


def same(first: Picture, second: Picture) -> bool:
    """Whether two pictures are equal to the bit."""
    return all(
        a.tobytes() == b.tobytes()
        for one, other in (
            (first.tracks[:2], second.tracks[:2]),
            (first.tracks.bank, second.tracks.bank),
            ((first.tracks.classes,), (second.tracks.classes,)),
            ((first.tracks.aside,), (second.tracks.aside,)),
            (first.tracks.features, second.tracks.features),
            (first.undetected[1:], second.undetected[1:]),
        )
        for a, b in zip(one, other, strict=True)
    )


class _Late(NamedTuple):
    history: History[Picture, Scan]
    cpu_s: float
    steps: int
    memory: int


def _run(
    scans: Sequence[Scan], order: Indices, rules: Rules[Picture, Scan], settings: Settings
) -> _Late:
    history, steps, memory = begun(nothing(settings, 0), rules, 0), 0, 0
    begin = time.process_time()
    for k in order:
        history, effort = taken(history, [scans[k]], rules)
        steps += effort.steps
        memory = max(memory, sum(snapshot.size for snapshot in history.snapshots))
    return _Late(history, time.process_time() - begin, steps, memory)
