"""Scenarios whose targets do not say who they are: found, right, honest, applied when trusted."""

from __future__ import annotations

import numpy as np
import pytest

from bench.in_process import played
from bench.registration.no_identities import SCENARIO, figures, first_found
from estimation.consistency import mean_interval, nees
from sim_world.scenario import load_scenario, with_overrides


def test_every_carrier_is_found_by_the_right_pairs() -> None:
    """Eight seeds of their own: all carriers, no gross error, NEES of 3 dof at 99.9 %."""
    scenario = load_scenario(SCENARIO)
    found = [
        frame
        for seed in range(5001, 5009)
        for frame in first_found(with_overrides(scenario, {"seed": seed}))
    ]
    assert len(found) == 16
    assert min(frame.probability for frame in found) > 0.99
    assert sum(frame.right for frame in found) > 0.97 * sum(frame.pairs for frame in found)
    scores = [float(nees(frame.error, frame.covariance)) / 3 for frame in found]
    low, high = mean_interval(3, len(found), 0.999)
    assert low < np.mean(scores) < high
    errors, known = (
        np.sqrt(np.mean([np.square(e[:2]).sum() for e in column]))
        for column in ([f.error for f in found], [f.known for f in found])
    )
    assert errors < 1.2 * known  # 16 frames; the full run asks for 1.1


def test_nothing_is_applied_before_a_mode_is_trusted() -> None:
    scenario = with_overrides(load_scenario(SCENARIO), {"seed": 77})
    trusted: set[str] = set()
    for now in played(scenario, steps=8):
        trusted |= {name for name, link in now.state.links.items() if link.followed}
        for name, found in now.corrections.items():
            assert found.state != "applied" or (name in trusted and found.mode_probability > 0.99)
    assert trusted == {"east", "north"}


@pytest.mark.slow
def test_the_demands_hold_at_full_size() -> None:
    assert all(figure.holds in (True, None) for figure in figures(11, 32_000))
