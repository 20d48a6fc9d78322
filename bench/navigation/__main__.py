"""Measure all that papers 003 and 004 demand, print it.

Run `python -m bench.navigation [--seed N] [--runs N] [--json]`.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator

import bench.navigation
from bench.figures import Figure, options, report


def _figures(seed: int, runs: int) -> Iterator[Figure]:
    """Those of every module of the package that measures something."""
    for found in pkgutil.iter_modules(bench.navigation.__path__):
        if found.name != "__main__":
            module = importlib.import_module(f"bench.navigation.{found.name}")
            if hasattr(module, "figures"):
                yield from module.figures(seed, runs)


def main() -> None:
    """Measure, print."""
    given = options("Navigation of carriers among beacons (papers 003 and 004).", runs=200)
    report(_figures(given.seed, given.runs), given)


if __name__ == "__main__":
    main()
