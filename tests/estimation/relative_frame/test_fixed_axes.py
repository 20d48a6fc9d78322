"""Own axes to fixed axes: the adjustment, which knows both, is the judge."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.frames import polar_from_east_north, wrap_pi
from estimation.relative_frame import (
    PolarLogs,
    RelativeFramePrior,
    adjustment,
    in_fixed_axes,
    in_own_axes,
)

DEG = np.pi / 180


@pytest.mark.parametrize("sigma_deg", [0.3, 1.0, 5.0])
@pytest.mark.parametrize("seed", range(4))
def test_it_is_what_the_adjustment_says_in_fixed_axes(seed: int, sigma_deg: float) -> None:
    """To a twentieth of a sigma and a tenth of a covariance: c1 is a point there, a mean here."""
    rng = np.random.default_rng(seed)
    offset, c = np.array([9000.0, -6000.0]), rng.normal(0, sigma_deg * DEG, 2)
    reported = offset + rng.normal(0, 800.0, 2)
    targets = rng.uniform(-15e3, 15e3, (9, 2))

    def logs(origin: np.ndarray, turn: float) -> PolarLogs:
        b, d = polar_from_east_north(targets - origin)
        noise = rng.normal(0, 1, (2, 9))
        return PolarLogs.from_sigmas(
            wrap_pi(b - turn + 0.3 * DEG * noise[0]), d + 50 * noise[1], 0.3 * DEG, 50.0
        )

    prior = RelativeFramePrior.from_sigmas(reported, 800, 800, sigma_deg * DEG, sigma_deg * DEG)
    found = adjustment(logs(np.zeros(2), c[0]), logs(offset, c[1]), prior)
    fixed = in_fixed_axes(found.own_axes, prior)
    sigmas = np.sqrt(np.diag(found.fixed.covariance))
    assert np.all(
        np.abs(fixed.offset_correction_m - found.fixed.offset_correction_m) < 0.05 * sigmas[:2]
    )
    assert abs(fixed.c1_rad - found.fixed.c1_rad) < 0.05 * sigmas[2]
    assert abs(fixed.c2_rad - found.fixed.c2_rad) < 0.05 * sigmas[3]
    np.testing.assert_allclose(np.diag(fixed.covariance), sigmas**2, rtol=0.1)
    back = in_own_axes(fixed, prior)
    np.testing.assert_allclose(back.q_m, found.own_axes.q_m, atol=1e-6)
    assert float(back.D_rad) == pytest.approx(float(found.own_axes.D_rad))
    np.testing.assert_allclose(back.covariance, found.own_axes.covariance, rtol=1e-6, atol=1e-9)
