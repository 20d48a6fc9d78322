"""Figures with their demands: what every script of `bench/` measures, prints and judges.

A script measures, makes a list of `Figure` by `told`, `at_most`, `at_least`, `between` or `near`,
and hands it to `report`. The text of a demand and its verdict come from one place, so they cannot
disagree; a demand that does not hold stays in the list and says so.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped, unused-ignore]

_KERNEL_S = 0.0095  # what `_kernel` took where the demands in seconds were written down


class Figure(NamedTuple):
    """One thing measured, and what is demanded of it (nothing: `demand` empty, `holds` None)."""

    name: str
    value: float
    unit: str = ""
    demand: str = ""
    holds: bool | None = None


def told(name: str, value: float, unit: str = "") -> Figure:
    """A figure worth knowing of which nothing is demanded."""
    return Figure(name, float(value), unit)


def at_most(name: str, value: float, limit: float, unit: str = "") -> Figure:
    """Demand value <= limit."""
    return Figure(name, float(value), unit, f"<= {limit:g}", bool(value <= limit))


def at_least(name: str, value: float, limit: float, unit: str = "") -> Figure:
    """Demand value >= limit."""
    return Figure(name, float(value), unit, f">= {limit:g}", bool(value >= limit))


def between(name: str, value: float, low: float, high: float, unit: str = "") -> Figure:
    """Demand low <= value <= high."""
    return Figure(name, float(value), unit, f"in [{low:g}, {high:g}]", bool(low <= value <= high))


def near(name: str, value: float, expected: float, tolerance: float, unit: str = "") -> Figure:
    """Demand the expected value within a tolerance."""
    demand = f"{expected:g} +- {tolerance:.2g}"
    return Figure(name, float(value), unit, demand, bool(abs(value - expected) <= tolerance))


class Options(NamedTuple):
    """The command line of every script."""

    seed: int
    runs: int
    json: bool


def options(description: str, runs: int, arguments: Sequence[str] | None = None) -> Options:
    """Read `--seed`, `--runs` (default: the full Monte-Carlo) and `--json`; BLAS on one thread."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--seed", type=int, default=1, help="of every random draw (default 1)")
    parser.add_argument(
        "--runs", type=int, default=runs, help=f"Monte-Carlo runs a point (default {runs})"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object instead of tables")
    threadpool_limits(limits=1)
    return Options(**vars(parser.parse_args(arguments)))


def report(figures: Iterable[Figure], given: Options) -> None:
    """Print the figures: a table for people or, with `--json`, one object."""
    figures = list(figures)
    if given.json:
        listed = [figure._asdict() for figure in figures]
        print(json.dumps({"figures": listed, "machine": machine(), "seed": given.seed}, indent=1))
        return
    verdicts = {True: "yes", False: "NO", None: ""}
    rows = [
        (f.name, f"{f.value:.4g} {f.unit}".strip(), f.demand, verdicts[f.holds]) for f in figures
    ]
    print(table(("figure", "measured", "demanded", "holds"), rows))
    judged = [f for f in figures if f.holds is not None]
    print(
        f"\n{sum(f.holds is True for f in judged)} of {len(judged)} demands hold, seed "
        f"{given.seed}, {given.runs} runs, {machine()}"
    )


def table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table with aligned columns, for the terminal and for docs/papers."""
    rows = [headings, *rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [" | ".join(map(str.ljust, row, widths)) for row in rows]
    lines.insert(1, "-|-".join("-" * width for width in widths))
    return "\n".join(f"| {line} |" for line in lines)


def machine() -> str:
    """What the times and the last digits depend on."""
    return f"{platform.machine()}, {os.cpu_count()} cores, numpy {np.__version__}"


def seconds(
    function: Callable[[], object],
    repeats: int = 5,
    clock: Callable[[], float] = time.perf_counter,
) -> float:
    """The shortest of some timings of a call: the others measure the neighbours."""
    return min(_timed(function, clock) for _ in range(repeats))


def time_ratio(
    function: Callable[[], object],
    reference: Callable[[], object],
    repeats: int = 5,
    clock: Callable[[], float] = time.perf_counter,
) -> float:
    """Shortest time of one call by that of another, taken in turns: both meet the neighbours."""
    both = [(_timed(function, clock), _timed(reference, clock)) for _ in range(repeats)]
    ours, theirs = np.min(both, axis=0)
    return float(ours / theirs)


def scaled_seconds(function: Callable[[], object], repeats: int = 5) -> float:
    """`seconds`, as it would be on the machine of the demands, by a numpy kernel timed here."""
    return seconds(function, repeats) * scale(repeats)


def scale(repeats: int = 5) -> float:
    """Seconds on the machine of the demands for one second here."""
    return _KERNEL_S / seconds(_kernel, repeats)


def cpu_scale(repeats: int = 5) -> float:
    """`scale` for what is measured by `time.process_time`, which a busy machine hardly changes."""
    return _KERNEL_S / seconds(_kernel, repeats, time.process_time)


def _timed(function: Callable[[], object], clock: Callable[[], float]) -> float:
    start = clock()
    function()
    return clock() - start


def _kernel() -> None:
    """Sines, a matrix product and many small calls, in about equal parts."""
    values = np.linspace(0.0, 6.0, 400_000)
    np.sin(values)
    square = values[:90_000].reshape(300, 300)
    for _ in range(2):
        square @ square
    for _ in range(2_500):
        values[:4].sum()
