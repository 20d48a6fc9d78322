"""Beacons, ranges, clocks, mutual navigation (papers 003, 004): `python -m bench.navigation`.

A module of this package that has `figures(seed, runs) -> Iterable[Figure]` contributes; `runs` is
the number of flights of benchmark G (200 in full). docs/papers/003.md and 004.md quote it.
"""
