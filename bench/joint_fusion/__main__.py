"""Measure what paper 002 demands of joint fusion, but for the tracker, and print it.

Run `python -m bench.joint_fusion [--seed N] [--runs N] [--json]`.
"""

from __future__ import annotations

from bench.figures import options, report
from bench.joint_fusion import classes, frames, instants, pairs, picture, rules, speed, track_logs

MODULES = (instants, rules, pairs, classes, track_logs, frames, picture, speed)


def main() -> None:
    """Measure, print."""
    given = options("Joint fusion of coordinates and features (paper 002).", runs=2000)
    report([f for module in MODULES for f in module.figures(given.seed, given.runs)], given)


if __name__ == "__main__":
    main()
