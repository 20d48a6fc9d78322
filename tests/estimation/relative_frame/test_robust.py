"""Wrong pairs: the truncated loss loses nothing to them, and says which they are."""

from __future__ import annotations

import numpy as np
import pytest

from bench.registration import robustness
from bench.registration.scenes import experiment, logs_of
from estimation.relative_frame import adjustment, robust_adjustment


@pytest.mark.parametrize("spread_m", [None, 2000.0])
def test_a_third_of_wrong_pairs_costs_a_tenth(spread_m: float | None) -> None:
    m = robustness.measure(3, 80, 20, spread_m)
    assert m.robust / m.clean < 1.1
    assert m.plain / m.clean > 3
    assert m.nees == pytest.approx(1, abs=0.3)  # 80 runs: sigma .09
    assert m.wrong_kept < 0.02 if spread_m is None else m.wrong_kept < 0.1
    assert m.right_lost < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("spread_m", [None, 2000.0])
@pytest.mark.parametrize("pairs", [10, 20, 50])
def test_demand_in_full(pairs: int, spread_m: float | None) -> None:
    m = robustness.measure(4, 4000 if pairs < 50 else 1000, pairs, spread_m)
    assert m.robust / m.clean <= 1.1


def test_without_wrong_pairs_it_is_the_adjustment() -> None:
    scene = experiment(np.random.default_rng(1), (40,), 8)
    robust, plain = robust_adjustment(*logs_of(scene)), adjustment(*logs_of(scene))
    whole = robust.kept.all(axis=1)
    assert whole.mean() > 0.9
    np.testing.assert_allclose(
        robust.found.own_axes.q_m[whole], plain.own_axes.q_m[whole], atol=1e-2
    )
    np.testing.assert_allclose(robust.chi2[whole], plain.fixed.chi2[whole], rtol=1e-6)
    np.testing.assert_array_equal(robust.dof, 2 * robust.kept.sum(axis=1))


def test_all_pairs_wrong_leaves_the_prior() -> None:
    """Four pairs that contradict the prior and each other by tens of kilometres."""
    scene, _ = robustness.spoilt(np.random.default_rng(2), (), 4, None)
    far = scene.other.take(slice(None))
    far.range_m[:] = [60e3, 90e3, 130e3, 200e3]
    robust = robust_adjustment(scene.own, far, scene.prior)
    assert robust.kept.sum() <= 1
