"""Measure all that paper 000 demands, print it.

Run `python -m bench.registration [--seed N] [--runs N] [--json]`.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Iterator
from typing import Protocol, cast

import bench.registration
from bench.figures import Figure, options, report


class Contributor(Protocol):
    """A module of this package that measures something."""

    def figures(self, seed: int, runs: int) -> Iterable[Figure]:
        """Its figures, by a Monte-Carlo in proportion to `runs`."""


def contributors() -> Iterator[Contributor]:
    """Every module of the package that has `figures`."""
    for found in pkgutil.iter_modules(bench.registration.__path__):
        if found.name != "__main__":
            module = importlib.import_module(f"bench.registration.{found.name}")
            if hasattr(module, "figures"):
                yield cast("Contributor", module)


def main() -> None:
    """Measure, print."""
    given = options("Registration of carriers (paper 000).", runs=40_000)
    found = [f for module in contributors() for f in module.figures(given.seed, given.runs)]
    if not given.json:
        published = bench.registration.published
        measured = {n: published.measure(given.seed, given.runs, n) for n in published.REFERENCE}
        title = "RMS after / before, estimate (bound)"
        print(f"{title}\n\n{published.paper_table(measured)}\n")
    report(found, given)


if __name__ == "__main__":
    main()
