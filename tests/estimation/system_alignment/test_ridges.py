"""Chains along a surface of probable constants: they visit every part by its probability."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.bordered import minimise
from estimation.system_alignment import dead_reckoning, prior, ranges
from estimation.system_alignment.model import Model
from estimation.system_alignment.ridges import sampled

RANGE_M, AWAY_M, SIGMA_BEACON_M = 400.0, 450.0, 150.0


@pytest.mark.slow
def test_a_ring_is_sampled_by_its_probability() -> None:
    """The angle on a ring about a hover is von Mises; the power 1/2 that is sampled halves kappa.

    1200 places of which some hundred are independent: a tenth of the standard deviation.
    """
    path = dead_reckoning(np.ones(20), 0.0, 0.0, 1e-3, 1e-3)
    known = prior([[0.0, AWAY_M, 0.0]], [SIGMA_BEACON_M, SIGMA_BEACON_M, 0.0])
    model = Model(path, ranges(np.arange(20), 0, RANGE_M, 2.0), known)
    mode = minimise(model, np.zeros((20, 2)), known.mean[known.free])
    found = sampled(model, [mode], np.ones(1), steps=150)
    assert found.dimensions == 1
    east, north = found.mean.reshape(-1, 2).T
    np.testing.assert_allclose(np.hypot(east, north), RANGE_M, atol=1.0)
    angle = np.linspace(-np.pi, np.pi, 1000)
    share = np.exp(RANGE_M * AWAY_M / SIGMA_BEACON_M**2 / 2 * np.cos(angle))
    expected = np.sqrt(np.sum(angle**2 * share) / np.sum(share))
    assert np.std(np.arctan2(east, north)) == pytest.approx(expected, rel=0.25)
    few, again = (sampled(model, [mode], np.ones(1), steps=5) for _ in range(2))
    np.testing.assert_array_equal(few.mean, again.mean)
