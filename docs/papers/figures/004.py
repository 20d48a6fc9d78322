"""Draws the figures of docs/papers/004.md: `python docs/papers/figures/004.py`, from the root.

As the paper's figures 2 and 3: errors of two users of one controller, and the radial error of the
secondary user over time. The numbers are measured anew.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[2]))

from bench.navigation import hierarchy  # noqa: E402
from bench.navigation.mutual import two_users  # noqa: E402
from bench.svg import RIGHT, TOP, Curve, linear, logarithmic, plot  # noqa: E402

COLOURS = ("#283", "#26a", "#69c", "#039", "#a6a", "#c44", "#d80")


def errors_of_two_users() -> None:
    """One draw."""
    errors = two_users(2, 1)[::6, 0]
    time = (np.arange(len(errors)) * 6 * hierarchy.INTERVAL_S).tolist()
    curves = [
        Curve(f"user {i + 1}", time, errors[:, i].tolist(), colour)
        for i, colour in enumerate(("#26a", "#c44"))
    ]
    size = 20 * float(np.ceil(np.abs(errors).max() / 20))
    axes = linear("s", 0, 600, 100), linear("error, m", -size, size, size / 4)
    plot(HERE / "004-users.svg", "Errors of two users, 25 deg apart", axes, curves, (RIGHT, TOP))


def radial_error_over_time() -> None:
    """2 sigma_r of the secondary user, by method."""
    curves = [
        Curve(name, _times(run.true_m), run.true_m[4::15].tolist(), colour)
        for (name, run), colour in zip(hierarchy.methods().items(), COLOURS, strict=True)
    ]
    axes = linear("s", 0, 600, 100), logarithmic("2 sigma_r, m", [10, 5000])
    plot(HERE / "004-radial.svg", "Secondary user, benchmark S", axes, curves, (RIGHT, TOP))


def _times(values: np.ndarray) -> list[float]:
    time = (np.arange(len(values)) + 1) * hierarchy.INTERVAL_S
    return [float(t) for t in time[4::15]]


if __name__ == "__main__":
    errors_of_two_users()
    radial_error_over_time()
