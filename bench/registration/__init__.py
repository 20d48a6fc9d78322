"""Registration of two and more carriers (paper 000): `python -m bench.registration`.

A module of this package that has `figures(seed, runs) -> Iterable[Figure]` contributes: it is
found by `__main__`, in alphabetical order. `runs` is what the closed form's table is given
(40 000 in full, 50 in a smoke run); a module takes the share it can afford. docs/papers/000.md
quotes what is printed.
"""

from bench.registration.published import REFERENCE, Means, closed_form_as_printed, measure
from bench.registration.scenes import Experiment, experiment
from bench.registration.speed import dense_difference

__all__ = [
    "REFERENCE",
    "Experiment",
    "Means",
    "closed_form_as_printed",
    "dense_difference",
    "experiment",
    "measure",
]
