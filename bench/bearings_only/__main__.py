"""Measure all that paper 001 demands, print it.

Run `python -m bench.bearings_only [--seed N] [--runs N] [--json]`.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator

import bench.bearings_only
from bench.bearings_only import published
from bench.figures import Figure, options, report


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Those of every module of the package that has some."""
    for found in pkgutil.iter_modules(bench.bearings_only.__path__):
        if found.name != "__main__":
            module = importlib.import_module(f"bench.bearings_only.{found.name}")
            yield from getattr(module, "figures", lambda seed, runs: ())(seed, runs)


def main() -> None:
    """Measure, print."""
    given = options("Trajectories from bearings (paper 001).", runs=1000)
    found = list(figures(given.seed, given.runs))
    if not given.json:
        print(f"{published.tables(given.seed, given.runs)}\n")
    report(found, given)


if __name__ == "__main__":
    main()
