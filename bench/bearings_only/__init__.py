"""Trajectories from bearings (paper 001): `python -m bench.bearings_only`.

A module of this package that has `figures(seed, runs) -> Iterable[Figure]` contributes: it is
found by `__main__`, in alphabetical order. `runs` is what a cell of Table 1 is given (1000 in
full, 20 in a smoke run); a module takes the share it can afford. docs/papers/001.md quotes what is
printed.
"""
