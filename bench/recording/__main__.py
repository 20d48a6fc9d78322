"""Recording and replay: every demand as a figure, ours beside the bare library and the bare bus.

Run `python -m bench.recording [--seed N] [--runs N] [--json]`. `--runs` is the size in per cent: at
100 the file that is read has 1 GB and twenty recorders are killed. Processes and sockets are real:
a hub, publishers, `crossfix record` and `crossfix replay` as their users start them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from bench.figures import Figure, options, report, told

from . import disks, kills, playing, reading, repeating, wire, writing


def main() -> None:
    """Measure, print."""
    given = options(__doc__ or "", runs=100)
    with tempfile.TemporaryDirectory() as folder:
        report(figures(Path(folder), given.seed, given.runs / 100), given)


def figures(folder: Path, seed: int, size: float) -> Iterator[Figure]:
    """Everything, in the order of a message's way: to the file, out of it, to the wire, fused."""
    yield from writing.figures(folder, seed, size)
    yield from reading.figures(folder, seed, size)
    yield from wire.figures(folder, seed, size)
    yield from kills.figures(folder, seed, max(2, round(20 * size)))
    yield from disks.figures(folder)
    yield from playing.figures(folder, seed, size)
    yield from repeating.figures(folder, seed, size)
    yield told("size of this run", 100 * size, "%")


if __name__ == "__main__":
    main()
