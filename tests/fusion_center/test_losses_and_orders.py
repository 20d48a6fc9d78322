"""Carriers that are lost and return; operators who interfere."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace as changed

from fusion_center import pipeline
from schemas.messages import Closed, Event, Input
from tests.fusion_center.scenes import (
    CLOSED_FORM,
    association,
    closed,
    correction,
    event,
    of_radar,
    own_axes_score,
    stamp,
    two_ships,
    without,
)


def test_a_lost_carrier_is_suspended_until_it_boots_again() -> None:
    rng = np.random.default_rng(1)
    scene = two_ships(8)
    state, _ = scene.run(4, rng)
    said = without(scene.said(5, rng), "b")
    state, outputs = pipeline.step(state, closed(5, said, lost=["b"]), said)
    assert (correction(outputs).state, correction(outputs).reason) == ("suspended", "b is lost")
    assert correction(outputs).own_axes is not None
    a, b = scene.ships
    again = replace(scene, ships=(a, replace(b, boot="b2", since_step=5)))
    states = []
    for step in range(6, 10):
        messages = again.said(step, rng) + ([again.info(again.ships[1])] if step == 6 else [])
        state, outputs = pipeline.step(state, closed(step, messages), messages)
        states.append(correction(outputs).state)
    assert states == ["candidate", "candidate", "applied", "applied"]
    logs = {log for target in association(outputs).targets for log in target.logs}
    assert {log.split("/")[1] for log in logs if log.startswith("b/")} == {"2"}


def test_when_own_is_lost_its_frame_is_predicted_and_nothing_is_applied() -> None:
    rng = np.random.default_rng(1)
    scene = two_ships(8)
    a, b = scene.ships
    scene = replace(scene, ships=(replace(a, velocity_mps=(0.0, 10.0)), b))
    state, outputs = scene.run(4, rng)
    held = correction(outputs[-1])
    for step in (5, 6, 7):
        said = without(scene.said(step, rng), "a")
        state, out = pipeline.step(state, closed(step, said, lost=["a"] * (step == 5)), said)
    found = correction(out)
    assert found.state == "suspended"
    assert found.reason == "the own carrier a is lost: its frame is predicted on"
    assert found.valid_t_ns == stamp(7)
    assert found.own_axes is not None
    assert held.own_axes is not None
    # own went on 3 s north at 10 m/s, so b lies 30 m further south, within its sigmas of truth
    assert found.own_axes.north_m - held.own_axes.north_m == pytest.approx(-30.0, abs=1.0)
    assert own_axes_score(found, scene.truth("b", 7)) < 5.4
    assert found.fixed_axes is not None
    assert held.fixed_axes is not None
    grown = found.fixed_axes.covariance[0] - held.fixed_axes.covariance[0]
    assert grown == pytest.approx((3 * state.settings.navigation.sigma_speed_mps) ** 2, rel=0.01)


def test_when_own_returns_every_correction_begins_anew() -> None:
    rng = np.random.default_rng(1)
    scene = two_ships(8)
    state, _ = scene.run(4, rng)
    a, b = scene.ships
    again = replace(scene, ships=(replace(a, boot="b2", since_step=4), b))
    messages = [*again.said(5, rng), again.info(again.ships[0])]
    _, outputs = pipeline.step(state, closed(5, messages), messages)
    assert correction(outputs).state == "candidate"


@pytest.mark.parametrize("lost", ["a", "b"])
def test_a_carrier_that_joins_again_without_a_boot_begins_anew(lost: str) -> None:
    rng = np.random.default_rng(1)
    scene = two_ships(8)
    state, outputs = scene.run(4, rng)
    assert correction(outputs[-1]).state == "applied"
    state, _ = pipeline.step(state, Closed(step=5, t_ns=stamp(4), lost=[lost]), [])
    said = scene.said(5, rng)
    _, out = pipeline.step(state, closed(6, said, t_ns=stamp(5), joined=[lost]), said)
    assert correction(out).state == "candidate"


def test_what_an_earlier_life_sent_is_late() -> None:
    scene = two_ships(8)
    state, _ = scene.run(2)
    a, b = scene.ships
    again = replace(scene, ships=(a, replace(b, boot="b2", since_step=2)))
    new = [*again.said(3), again.info(again.ships[1])]
    state, _ = pipeline.step(state, closed(3, new), new)
    ghost = [changed(scene.report(b, 4), seq=3)]
    state, outputs = pipeline.step(state, closed(4, ghost), ghost)
    assert of_radar(outputs, "b").late == 8
    assert of_radar(outputs, "b").logs == 0


def test_an_operator_suspends_and_resumes() -> None:
    rng = np.random.default_rng(1)
    scene = two_ships(8)
    state, _ = scene.run(4, rng)
    states = []
    for step in range(5, 11):
        orders = {5: "suspend", 7: "resume"}
        messages = scene.said(step, rng)
        events = [event(step, seq=step, kind=orders[step], carrier="b")] if step in orders else []
        now = closed(step, messages)
        state, outputs = pipeline.step(state, now, [*messages, *events])
        states.append(correction(outputs).state)
    assert states == ["suspended", "suspended", "candidate", "candidate", "applied", "applied"]


def test_an_event_of_another_step_has_no_effect() -> None:
    scene = two_ships(8)
    messages = scene.said(1)
    early = event(2, kind="suspend", carrier="b")
    _, outputs = pipeline.step(scene.initial(), closed(1, messages), [*messages, early])
    assert correction(outputs).state == "candidate"


def test_a_setting_is_changed_from_its_step_on() -> None:
    scene = two_ships(8)
    messages = scene.said(1)
    order = event(1, kind="set", setting="monitor.apply_after", value=1)
    _, outputs = pipeline.step(scene.initial(), closed(1, messages), [*messages, order])
    assert correction(outputs).state == "applied"


@pytest.mark.parametrize(
    "order",
    [
        {"kind": "set", "setting": "monitor.apply_afte", "value": 1},
        {"kind": "set", "setting": "monitor.apply_after", "value": -1},
        {"kind": "set", "setting": "own", "value": "b"},
        {"kind": "bind", "pair": ["a/radar/t0"]},
        {"kind": "forbid", "pair": ["a/radar/t0", "b"]},
        {"kind": "suspend"},
    ],
)
def test_what_cannot_be_carried_out_is_left_out(order: dict[str, Any]) -> None:
    scene = two_ships(8)
    messages = scene.said(1)
    now = closed(1, messages)
    plain, outputs = pipeline.step(scene.initial(), now, messages)
    state, same = pipeline.step(scene.initial(), now, [*messages, event(1, **order)])
    assert same == outputs
    assert state.settings == plain.settings


def test_bound_pairs_are_registered_and_forbidden_ones_are_not() -> None:
    scene = two_ships(4, identities=False, fusion=CLOSED_FORM)
    messages = scene.said(1)
    orders: list[Input | Event] = [
        event(1, seq=n + 1, kind="bind", pair=[f"b/radar/t{n}", f"a/radar/t{n}"]) for n in range(3)
    ]
    state, outputs = pipeline.step(scene.initial(), closed(1, messages), [*messages, *orders])
    assert correction(outputs).pairs == 3
    assert {target.method for target in association(outputs).targets} == {"operator"}
    messages = scene.said(2)
    change = event(2, seq=4, kind="forbid", pair=["a/radar/t0", "b/radar/t0"])
    _, outputs = pipeline.step(state, closed(2, messages), [*messages, change])
    assert correction(outputs).pairs == 2
