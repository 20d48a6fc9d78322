"""The paper's Table 1 on benchmarks S and M: every method beside the bound."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from bench.bearings_only.scenes import BENCHMARKS, KINDS, MOTIONS, NAMES, Drawn
from bench.bearings_only.unknown import HALF, cell, seed_errors
from bench.figures import Figure, at_most, near, table, told
from estimation.arrays import Array
from estimation.bearings_only import (
    Estimate,
    chebyshev_first,
    chebyshev_second,
    maximum_likelihood,
    n_bearings,
    n_polynomials,
)
from estimation.bearings_only.seeds import pseudo_linear_rows, rotated_rows

LIMITS = (10, 60)
METHODS = (
    "N-bearings",
    "N-polynomials, n = 1",
    "N-polynomials, n = 2",
    "N-polynomials, n = 3",
    "known motion",
    "unknown motion",
)

PRINTED = {  # range and speed, N-bearings and N-polynomials [%]
    ("A", 10): ("0.02-3", "0.01-1.5", "0.01-1.5", "0.01-1.3"),
    ("A", 60): ("3-8", "2.5-6", "3-12", "2.5-8"),
    ("B", 10): ("15-80", "1-40", "25-100", "1-30"),
    ("B", 60): ("35-190", "15-80", "35-150", "17-90"),
    ("C", 10): ("60-350", "10-40", "60-280", "5-32"),
    ("C", 60): ("80-420", "25-65", "70-350", "22-45"),
    ("D", 10): ("70-400", "15-50", "60-340", "12-48"),
    ("D", 60): ("80-450", "25-70", "80-410", "22-57"),
}


class Errors(NamedTuple):
    """Median absolute errors [%] at the last bearing, and the mean error of the range."""

    range: float
    speed: float
    bias: float


@cache
def medians(seed: int, runs: int, name: str, kind: str, limit: int) -> dict[str, Errors]:
    """Errors of every method in one cell."""
    scene, solved = cell(seed, runs, name, kind, limit)
    tracks = [n_bearings(scene.given), *(n_polynomials(scene.given, n) for n in (1, 2, 3))]
    errors = [seed_errors(scene, track) for track in tracks]
    errors.append(likelihood_errors(scene, maximum_likelihood(scene.given, MOTIONS[kind])))
    errors.append((solved.error, solved.speed_error))
    return {
        method: Errors(_median(in_range), _median(in_speed), float(in_range.mean()))
        for method, (in_range, in_speed) in zip(METHODS, errors, strict=True)
    }


def likelihood_errors(scene: Drawn, found: Estimate) -> tuple[Array, Array]:
    """Errors of range and speed [%] of a known motion."""
    speed = np.linalg.norm(found.state(scene.given.t_s[..., -1]).velocity_mps, axis=-1)
    inverse = found.inverse_range().value
    return 100 * (1 / inverse / scene.range_m - 1), 100 * (speed / scene.speed_mps - 1)


def _median(errors: Array) -> float:
    return float(np.median(np.abs(errors)))


def tables(seed: int, runs: int) -> str:
    """Range and speed as Markdown, S and M, beside the printed intervals."""
    both = []
    for quantity in ("range", "speed"):
        rows = []
        for name in BENCHMARKS:
            for kind in KINDS:
                rows += [_row(seed, runs, name, kind, limit, quantity) for limit in LIMITS]
        paper = ("paper: N-bearings", "paper: N-polynomials")
        bound = ("bound x .6745",) if quantity == "range" else ()
        headings = ("", *METHODS, *bound, *paper)
        both.append(f"Median error of {quantity}, %\n\n{table(headings, rows)}")
    return "\n\n".join(both)


def _row(seed: int, runs: int, name: str, kind: str, limit: int, quantity: str) -> list[str]:
    errors = medians(seed, runs, name, kind, limit)
    values = [getattr(errors[method], quantity) for method in METHODS]
    printed = PRINTED[kind, limit]
    if quantity == "range":
        scene, _ = cell(seed, runs, name, kind, limit)
        values.append(100 * HALF * float(scene.bound[0]))
        printed = printed[:2]
    else:
        printed = printed[2:]
    return [f"{name} {limit}' {NAMES[kind]}", *(f"{value:.3g}" for value in values), *printed[:2]]


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Demand 1, and how much of Table 1 the chosen speeds reproduce."""
    scene, _ = cell(seed, runs, "S", "A", 60)
    first = n_polynomials(scene.given, 3).position_m
    second = n_polynomials(scene.given, 3, chebyshev_second).position_m
    t = np.full(len(scene.range_m), 123.0)
    yield at_most(
        "both kinds of polynomials: tracks apart", np.abs(first(t) - second(t)).max(), 1e-6, "m"
    )
    values = chebyshev_first(np.linspace(-1, 1, len(scene.given.t_s)), 3)
    plain, turned = pseudo_linear_rows(scene.given, values), rotated_rows(scene.given, values)
    apart = max(np.abs(a + b).max() / np.abs(a).max() for a, b in zip(plain, turned, strict=True))
    yield at_most("rotated form against pseudo-linear form, relative", apart, 1e-12)
    uniform = medians(seed, runs, "S", "A", 60)["N-polynomials, n = 1"]
    yield near("S 60' uniform, degree 1: median", uniform.range, 7.3, 0.6, "%")
    yield at_most("S 60' uniform, degree 1: bias", uniform.bias, 0, "%")
    for kind in KINDS:
        errors = medians(seed, runs, "S", kind, 60)
        for method in METHODS[:4]:
            yield told(f"S 60' {NAMES[kind]}: {method}, median", errors[method].range, "%")
    for n in (2, 3):
        yield told(
            f"S, degree {n}: of 32 printed intervals, those that hold the median",
            _inside(seed, runs, n),
        )
        better = _better(seed, runs, n)
        yield told(f"S and M, not uniform: of 12 rows, degree {n} nearer than N-bearings", better)


def _inside(seed: int, runs: int, degree: int) -> int:
    """Medians of both methods on S, range and speed, inside the printed intervals."""
    count = 0
    for kind in KINDS:
        for limit in LIMITS:
            errors = medians(seed, runs, "S", kind, limit)
            rival, ours = errors[METHODS[0]], errors[METHODS[degree]]
            values = rival.range, ours.range, rival.speed, ours.speed
            for value, text in zip(values, PRINTED[kind, limit], strict=True):
                low, high = map(float, text.split("-"))
                count += low <= value <= high
    return count


def _better(seed: int, runs: int, degree: int) -> int:
    """Rows of non-uniform motion in which N-polynomials beat N-bearings in range."""
    count = 0
    for name in BENCHMARKS:
        for kind in KINDS[1:]:
            for limit in LIMITS:
                errors = medians(seed, runs, name, kind, limit)
                count += errors[METHODS[degree]].range < errors[METHODS[0]].range
    return count
