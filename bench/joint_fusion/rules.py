"""The paper's rule (3) by itself: as printed, corrected, and where it accepts nothing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.figures import Figure, near, told
from estimation.arrays import Array
from estimation.association_rules import blind_below, paper_rule

SPARED = 5.15
"""Displacement in sigmas at which the corrected rule accepts .5 % of different pairs."""


def printed_rule(difference: Array, sigma: float, alpha: float) -> Array:
    """The rule at gamma = 1 as printed: exp(a d / s^2) - exp(-a d / s^2) <= exp(a^2 / 2 s^2)."""
    pull = np.clip(alpha * difference / sigma**2, -700.0, 700.0)
    accepted: Array = 2.0 * np.sinh(pull) <= np.exp(alpha**2 / (2.0 * sigma**2))
    return accepted


def accepted(seed: int, runs: int, alpha: float) -> dict[str, float]:
    """Shares of pairs accepted, of one target and of two that are alpha apart, in one coordinate.

    Args:
        alpha: in sigmas of the difference; the two targets lie on either side equally often.
    """
    rng = np.random.default_rng([seed, int(1000 * alpha)])
    same = rng.normal(0.0, 1.0, runs)
    different = same + alpha * rng.choice([-1.0, 1.0], runs)
    return {
        "corrected, one target": _share(same, alpha),
        "corrected, two targets": _share(different, alpha),
        "printed, one target": float(printed_rule(same, 1.0, alpha).mean()),
        "printed, two targets": float(printed_rule(different, 1.0, alpha).mean()),
    }


def _share(difference: Array, alpha: float) -> float:
    return float(paper_rule(difference[:, None], 1.0, [alpha]).accepted.mean())


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """What the misprint does, and where the corrected rule is blind."""
    draws = max(100 * runs, 20_000)
    for alpha in (1.0, 1.5, 2.0, 3.0, SPARED):
        for name, share in accepted(seed, draws, alpha).items():
            text = f"rule (3) {name} {alpha:g} sigma apart: accepted"
            if alpha == SPARED and name == "printed, two targets":
                yield near(text, share, 0.5, 0.01)
            elif alpha == SPARED and name == "corrected, two targets":
                yield near(text, share, 0.005, 0.002)
            else:
                yield told(text, share)
    yield near("rule (3) accepts nothing up to, gamma = 1", float(blind_below(1.0)), 1.18, 0.005)
