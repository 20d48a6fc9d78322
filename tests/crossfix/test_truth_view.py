"""The truth is shown as the own sensors would see it: their north is what counts."""

from __future__ import annotations

import numpy as np
import pytest

from crossfix.report.axes import View, truth_seen_by
from estimation.frames import Site, target_from_source
from schemas.messages import TruthCarriers

HERE = Site(0.6, 0.1, 0.0)
TARGET_M = np.array([[3000.0, 4000.0, 0.0]])


@pytest.mark.parametrize(("north_rad", "added_rad"), [(0.02, 0.02), (0.02, 0.0), (0.0, 0.02)])
def test_a_sensor_that_adds_the_error_of_its_north_sees_along_true_north(
    north_rad: float, added_rad: float
) -> None:
    truth = TruthCarriers(
        boot="w",
        seq=1,
        step=1,
        t_ns=0,
        carrier=["own"],
        position_m=[[0.0, 0.0, 0.0]],
        velocity_mps=[[0.0, 0.0, 0.0]],
        acceleration_mps2=[[0.0, 0.0, 0.0]],
        heading_rad=[0.0],
        north_error_rad=[north_rad],
        azimuth_bias_rad=[added_rad],
    )
    believed = View(HERE, target_from_source(HERE, HERE))
    ((east, north),) = truth_seen_by("own", truth, HERE, believed).placed(TARGET_M)
    seen_rad = np.arctan2(east, north)
    true_rad = np.arctan2(3000.0, 4000.0)
    assert seen_rad == pytest.approx(true_rad - north_rad + added_rad, abs=1e-12)
