"""Valid messages of any size never stop the fusion, and what it says of them is valid again."""

from __future__ import annotations

from random import Random
from typing import Any

import pytest

from fusion_center import pipeline
from fusion_center.settings import settings_from
from schemas import codec
from schemas.messages import (
    Closed,
    DeclaredCarrier,
    DeclaredScenario,
    Input,
    Navigation,
    Origin,
    Pose,
    SourceInfo,
    SourceProperties,
    SourceReport,
    StreamEnd,
)
from tests.bad_input.extremes import Mean

SECOND = 10**9
CARRIERS = ("alpha", "bravo")
STREAMS = ("info", "navigation", "radar")
SCENARIO = DeclaredScenario(
    name="r",
    origin=Origin(latitude_rad=0.7, longitude_rad=0.5),
    epoch_ns=0,
    step_ns=SECOND,
    steps=100,
    carriers=[
        DeclaredCarrier(name=name, sigma_position_m=1000.0, sigma_north_rad=0.02)
        for name in CARRIERS
    ],
)


def sane(dice: Random, **envelope: Any) -> list[Input]:
    """What an honest carrier says at one instant."""
    pose = Pose(latitude_rad=0.7, longitude_rad=0.5 + dice.uniform(-0.002, 0.002))
    radar = SourceProperties(sigma_bearing_rad=0.005, sigma_range_m=30.0)
    names = [f"t{i}" for i in range(12)]
    return [
        SourceInfo(stream="info", source="radar", properties=radar, **envelope),
        Navigation(stream="navigation", pose=pose, **envelope),
        SourceReport(
            stream="radar",
            bearing_rad=[dice.uniform(0, 6) for _ in names],
            range_m=[dice.uniform(100, 2e4) for _ in names],
            identity=list(names),
            identity_kind=["x"] * 12,
            **envelope,
        ),
    ]


@pytest.mark.parametrize("method", ["joint", "closed_form", "adjustment"])
@pytest.mark.parametrize("seed", range(12))
def test_a_carrier_that_says_absurd_things_stops_nothing(seed: int, method: str) -> None:
    dice, mean = Random(seed), Mean(seed)
    state = pipeline.initial(SCENARIO, settings_from({"registration": {"method": method}}))
    hostile = dice.choice(CARRIERS)
    published = 0
    for step in range(1, 16):
        messages: list[Input] = []
        for name in CARRIERS:
            envelope = {"carrier": name, "boot": "b", "seq": step, "t_ns": step * SECOND}
            if name == hostile and step > 3:
                messages += [draw(**envelope) for draw in (mean.info, mean.navigation, mean.report)]
            else:
                messages += sane(dice, **envelope)
        manifest = [
            StreamEnd(carrier=name, boot="b", stream=stream, last_seq=step)
            for name in CARRIERS
            for stream in STREAMS
        ]
        heard = [codec.decode(type(m), codec.encode(m)) for m in messages]
        closed = Closed(step=step, t_ns=step * SECOND, manifest=manifest)
        state, outputs = pipeline.step(state, closed, heard)
        for output in outputs:
            codec.decode(type(output.message), codec.encode(output.message))
            published += 1
    assert published == 15 * 4
