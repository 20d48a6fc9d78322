"""Draws the figures of docs/papers/002.md: `python docs/papers/figures/002.py`, from the root.

The numbers are measured anew.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[2]))

from bench.joint_fusion import pairs  # noqa: E402
from bench.joint_fusion.rules import accepted  # noqa: E402
from bench.svg import BOTTOM, RIGHT, Curve, linear, plot  # noqa: E402
from estimation.time_alignment import sigma_at_last  # noqa: E402

RED, BLUE, GREEN, GREY = "#c44", "#26a", "#283", "#888"


def right_pairs_against_distance() -> None:
    """Share of right pairs of each rule as neighbours come nearer."""
    distances = (1, 1.5, 2, 3, 4, 6, 8)
    colours = dict(zip(pairs.RULES, (GREY, RED, GREEN, BLUE), strict=True))
    curves = [
        Curve(rule, distances, [pairs.measure(1, 40, d, rule).right for d in distances], colour)
        for rule, colour in colours.items()
    ]
    axes = linear("mean distance of neighbours, sigma", 0, 8, 1), linear("share", 0, 1, 0.2)
    plot(HERE / "002-pairs.svg", "Right pairs by common objects", axes, curves, (RIGHT, BOTTOM))


def acceptance_against_displacement() -> None:
    """What the rule accepts, as printed and corrected."""
    alphas = np.arange(0.25, 6.01, 0.25).tolist()
    found = [accepted(1, 40_000, alpha) for alpha in alphas]
    curves = [
        Curve(name, alphas, [f[name] for f in found], colour, dashed=name.endswith("two targets"))
        for name, colour in (
            ("corrected, one target", BLUE),
            ("corrected, two targets", BLUE),
            ("printed, one target", RED),
            ("printed, two targets", RED),
        )
    ]
    axes = linear("alpha, sigma", 0, 6, 1), linear("share accepted", 0, 1, 0.2)
    plot(HERE / "002-rule.svg", "Rule (3) at gamma = 1", axes, curves, (RIGHT, BOTTOM - 32))


def sigma_against_carrying() -> None:
    """The paper's formula, with its limits."""
    ratios = np.linspace(0, 6, 25).tolist()
    curves = [
        Curve("s_OB / s", ratios, sigma_at_last(1.0, ratios).tolist(), BLUE),
        Curve("sqrt(1/2)", [0.0, 6.0], [float(np.sqrt(0.5))] * 2, GREY, dashed=True),
    ]
    axes = linear("sigma of carrying / sigma of measuring", 0, 6, 1), linear("ratio", 0.6, 1, 0.1)
    plot(HERE / "002-last.svg", "Fused at the last measurement", axes, curves, (RIGHT, BOTTOM - 60))


if __name__ == "__main__":
    right_pairs_against_distance()
    acceptance_against_displacement()
    sigma_against_carrying()
