"""Ships in company: features tell them apart, and who reports them worse than declared is named."""

from __future__ import annotations

import random

import pytest
from msgspec.structs import replace

from bench.in_process import Played, played
from bench.joint_fusion.picture import SCENARIO, WAYS, judged, nameless, run
from fusion_center import pipeline
from fusion_center.settings import settings_from
from fusion_center.state import State, pack, unpack
from schemas.messages import Closed, Input, Quality, SourceQuality, StreamEnd
from sim_world.scenario import load_scenario, with_overrides

STEPS = 60


@pytest.fixture(scope="module")
def company() -> list[Played]:
    return run(1, WAYS["learned"], STEPS)[1]


def sources(steps: list[Played]) -> dict[str, SourceQuality]:
    """The last that was told of each carrier's radar."""
    every = (out.message for step in steps for out in step.outputs)
    told = [source for m in every if isinstance(m, Quality) for source in m.sources]
    return {source.carrier: source for source in told if source.features}


def test_a_source_that_errs_more_than_it_declares_is_named(company: list[Played]) -> None:
    own, other = sources(company)["own"], sources(company)["other"]
    assert own.features["length_m"].learned_sigma == pytest.approx(10.0, rel=0.15)
    assert other.features["length_m"].declared_sigma == pytest.approx(10.0)
    assert other.features["length_m"].learned_sigma == pytest.approx(30.0, rel=0.25)
    assert other.features["emitter"].declared_right == pytest.approx(0.85)
    assert other.features["emitter"].learned_right == pytest.approx(0.7, abs=0.08)
    assert "length_m errs" in other.flag
    assert "errs" not in own.flag


def test_what_is_learnt_survives_packing(company: list[Played]) -> None:
    state = company[-1].state
    assert state.picture.learned
    assert pack(unpack(pack(state))) == pack(state)


def test_a_source_that_is_less_often_right_of_classes_is_named() -> None:
    strait = load_scenario(SCENARIO.with_name("strait.toml"))
    key = "carriers.levante.sensors.radar.classes.errors"
    liar = list(played(with_overrides(strait, {key: {"accuracy": 0.4}}), steps=35))
    levante = sources(liar)["levante"]
    assert levante.features["class"].declared_right == pytest.approx(0.85)
    assert levante.features["class"].learned_right < 0.6
    assert "class is right" in levante.flag
    assert "class" not in sources(liar)["siroco"].flag


def in_parts(steps: list[Played], seed: int) -> list[tuple[Closed, list[Input]]]:
    """The same messages, those of the other carrier held up by two steps now and then."""
    draw, parts, until = random.Random(seed), [], 0
    ends: dict[tuple[str, str], StreamEnd] = {}
    due: list[list[Input]] = [[] for _ in steps]
    for number, step in enumerate(steps):
        until = max(number + 2 * (draw.random() < 0.3), until)
        for message in map(nameless, step.said):
            held = message.carrier == "other" and message.stream != "info"
            due[min(until, len(steps) - 1) if held else number].append(message)
    for step, given in zip(steps, due, strict=True):
        for message in given:
            ends[message.carrier, message.stream] = StreamEnd(
                carrier=message.carrier,
                boot=message.boot,
                stream=message.stream,
                last_seq=message.seq,
            )
        parts.append((replace(step.closed, manifest=[*ends.values()]), given))
    return parts


def ended(parts: list[tuple[Closed, list[Input]]]) -> State:
    scenario = load_scenario(SCENARIO).declared
    state = pipeline.initial(scenario, settings_from(scenario.fusion))
    for closed, said in parts:
        state, _ = pipeline.step(state, closed, said)
    return state


def test_late_reports_teach_the_same_bits(company: list[Played]) -> None:
    parts = in_parts(company[:30], 1)
    newest, behind = -1, 0
    for _, said in parts:
        behind += sum(m.t_ns < newest for m in said)
        newest = max([newest, *(m.t_ns for m in said)])
    assert behind > 3
    late, in_order = ended(parts), company[29].state
    assert pack(replace(late, past=(), published={})) == pack(
        replace(in_order, past=(), published={})
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", [5, 6])
def test_features_with_learned_sigmas_hold_the_picture_together(seed: int) -> None:
    blind, best = (judged(run(seed, WAYS[way])) for way in ("without features", "learned"))
    assert blind.wrong > 0.08
    assert best.wrong < 0.25 * blind.wrong
    assert best.changes <= blind.changes
    assert best.gospa_m < blind.gospa_m
