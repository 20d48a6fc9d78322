"""Pictures against the truth: a track where own navigation must put its target has no error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from crossfix.evaluation import picture_errors
from estimation.frames import Site, site_at
from schemas.messages import Navigation, Pose, Track, Tracks, TruthCarriers, TruthTargets
from sim_world.scenario import load_scenario

DECLARED = load_scenario(Path(__file__).parents[2] / "scenarios" / "group.toml").declared
ORIGIN = Site(
    DECLARED.origin.latitude_rad, DECLARED.origin.longitude_rad, DECLARED.origin.altitude_m
)
OFFSET_M = (120.0, -80.0)
OWN_MPS, TARGET_M, TARGET_MPS, TARGET_MPS2 = (60.0, -20.0), (900.0, 400.0), (150.0, 90.0), 4.0
SECOND = 10**9


def own_says(seq: int, clock_s: float) -> Navigation:
    """Every second of true time, stamped by its own clock."""
    way = [OWN_MPS[0] * seq, OWN_MPS[1] * seq]
    there = site_at(ORIGIN, [OFFSET_M[0] + way[0], OFFSET_M[1] + way[1], 0.0])
    return Navigation(
        carrier="one", boot="a", stream="navigation", seq=seq, step=seq,
        t_ns=DECLARED.epoch_ns + seq * SECOND + round(clock_s * SECOND),
        pose=Pose(
            latitude_rad=there.latitude_rad, longitude_rad=there.longitude_rad, heading_rad=0.0
        ),
        reckoned_east_m=way[0], reckoned_north_m=way[1],
    )  # fmt: skip


def truth(step: int, clock_s: float) -> tuple[TruthTargets, TruthCarriers]:
    east, north = (p + v * step for p, v in zip(TARGET_M, TARGET_MPS, strict=True))
    known: dict[str, Any] = {
        "boot": "w",
        "seq": step,
        "step": step,
        "t_ns": DECLARED.epoch_ns + step * SECOND,
    }
    targets = TruthTargets(
        **known, number=[1], position_m=[[east + TARGET_MPS2 * step**2 / 2, north, 0.0]],
        velocity_mps=[[TARGET_MPS[0] + TARGET_MPS2 * step, TARGET_MPS[1], 0.0]],
        acceleration_mps2=[[TARGET_MPS2, 0.0, 0.0]],
    )  # fmt: skip
    own = TruthCarriers(
        **known, carrier=["one"], position_m=[[OWN_MPS[0] * step, OWN_MPS[1] * step, 0.0]],
        velocity_mps=[[*OWN_MPS, 0.0]], acceleration_mps2=[[0.0] * 3], heading_rad=[0.0],
        north_error_rad=[0.0], clock_offset_s=[clock_s],
    )  # fmt: skip
    return targets, own


@pytest.mark.parametrize("clock_s", [-1.3, -0.4, 0.0, 0.4, 1.3])
def test_the_truth_is_put_where_own_navigation_is_at_the_instant_of_the_own_clock(
    clock_s: float,
) -> None:
    step, t_s = 6, 6 - clock_s
    believed = (
        OFFSET_M[0] + TARGET_M[0] + TARGET_MPS[0] * t_s + TARGET_MPS2 * t_s**2 / 2,
        OFFSET_M[1] + TARGET_M[1] + TARGET_MPS[1] * t_s,
    )
    track = Track(
        id="t1", position_m=[*believed], velocity_mps=[*TARGET_MPS],
        covariance=[1, 0, 0, 0, 1, 0, 0, 1, 0, 1], existence=1.0,
    )  # fmt: skip
    t_ns = DECLARED.epoch_ns + step * SECOND
    picture = Tracks(centre="fusion", seq=1, step=step, t_ns=t_ns, tracks=[track])
    messages = [m for k in range(1, step + 1) for m in (*truth(k, clock_s), own_says(k, clock_s))]
    (error,) = picture_errors(DECLARED, "one", [*messages, picture])
    assert error.error_m < 0.5  # the Earth is round
