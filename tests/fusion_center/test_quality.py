"""What each Closed brought is counted, and nothing unused goes unsaid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from msgspec.structs import replace as changed

from fusion_center import pipeline
from schemas.messages import Input, SourceReport, StreamSpan
from tests.fusion_center.scenes import (
    CLOSED_FORM,
    Ship,
    association,
    closed,
    correction,
    named,
    of_radar,
    quality,
    stamp,
    two_ships,
)


def test_quality_counts_every_source() -> None:
    scene = two_ships(8)
    _, outputs = scene.run(2, np.random.default_rng(1))
    row = of_radar(outputs[-1], "a")
    assert (row.logs, row.associated, row.nis_dof, row.late, row.flag) == (8, 8, 16, 0, "")
    assert 0 < row.nis < 4
    assert quality(outputs[-1]).messages == 4
    assert quality(outputs[0]).messages == 6


def test_logs_are_associated_in_the_closed_of_their_registration() -> None:
    scene = two_ships(8)
    a, b = scene.ships
    first = [scene.info(a), scene.info(b), scene.navigation(a, 1), scene.report(a, 1)]
    state, outputs = pipeline.step(scene.initial(), closed(1, first), first)
    assert association(outputs).alone == {}
    second: list[Input] = [scene.navigation(b, 1), scene.report(b, 1)]
    _, outputs = pipeline.step(state, closed(2, second), second)
    assert correction(outputs).pairs == 8
    own, other = of_radar(outputs, "a"), of_radar(outputs, "b")
    assert (own.logs, own.associated, own.nis_dof) == (0, 8, 16)
    assert (other.logs, other.associated, other.nis_dof) == (8, 8, 16)
    assert association(outputs).alone == {"a": 0, "b": 0}


def test_geodetic_logs_of_several_instants_are_placed_from_a_moving_carrier() -> None:
    """One target at rest, logged twice by a carrier under way: one place over ground."""
    scene = two_ships(1)
    a, b = scene.ships
    scene = replace(scene, ships=(replace(a, velocity_mps=(50.0, 0.0), north_error_rad=0.0), b))
    state, _ = scene.run(2)
    report = SourceReport(
        carrier="a", boot="b1", stream="ais", seq=1, t_ns=stamp(3), track_id=["p", "q"],
        latitude_rad=[0.716] * 2, longitude_rad=[0.507] * 2, sigma_position_m=[5.0] * 2,
        time_offset_s=[0.0, -2.0],
    )  # fmt: skip
    state, _ = pipeline.step(state, closed(3, [report]), [report])
    one, two = state.carriers["a"].logs["ais"].place_m[0]
    np.testing.assert_allclose(one, two, atol=0.05)


def test_missing_sigmas_are_counted_and_missing_defaults_flagged() -> None:
    scene = two_ships(8)
    bare = {"sigma_bearing_rad": None, "sigma_range_m": None}
    messages = [
        changed(m, **bare) if m.carrier == "b" and m.stream == "radar" else m for m in scene.said(1)
    ]
    now = closed(1, messages)
    _, outputs = pipeline.step(scene.initial(), now, messages)
    assert of_radar(outputs, "b").sigma_defaults == 8
    assert correction(outputs).pairs == 8
    ignorant = [
        changed(m, properties=changed(m.properties, sigma_range_m=None))  # type: ignore[attr-defined]
        if m.stream == "info"
        else m
        for m in messages
    ]
    _, outputs = pipeline.step(scene.initial(), now, ignorant)
    assert correction(outputs).pairs == 0
    assert of_radar(outputs, "b").flag == "logs without sigma, and no default: not used"


def test_an_identity_claimed_twice_pairs_with_nothing_and_is_flagged() -> None:
    scene = two_ships(8)
    twice = ["n0", "n0", *named(8)[2:]]
    messages = [
        changed(m, identity=twice) if m.carrier == "b" and m.stream == "radar" else m
        for m in scene.said(1)
    ]
    _, outputs = pipeline.step(scene.initial(), closed(1, messages), messages)
    assert correction(outputs).pairs == 6
    assert of_radar(outputs, "b").flag == "two logs claim name/n0: not paired"


def test_late_and_future_reports_are_counted_and_not_fused() -> None:
    scene = two_ships(8)
    state, _ = scene.run(5)
    late, future = (changed(m, t_ns=stamp(t)) for m, t in
                    zip(scene.said(6)[1::2], (1.5, 7.5), strict=True))  # fmt: skip
    assert (late.stream, future.stream) == ("radar", "radar")
    said = [late, future]
    after, outputs = pipeline.step(state, closed(6, said), said)
    assert (of_radar(outputs, "a").logs, of_radar(outputs, "a").late) == (0, 8)
    assert quality(outputs).late == 1
    assert quality(outputs).messages == 0
    assert of_radar(outputs, "b").flag == "stamped 1.5 s after the closing: not fused"
    assert after.carriers == state.carriers
    assert after.links == state.links


def test_what_was_given_up_is_counted() -> None:
    scene = two_ships(8)
    messages = scene.said(1)
    ends = closed(1, [changed(m, seq=3) if m.stream == "radar" else m for m in messages])
    lost = [StreamSpan(carrier=c, boot="b1", stream="radar", first=2, last=3) for c in "ab"]
    now = changed(ends, gave_up=lost)
    _, outputs = pipeline.step(scene.initial(), now, messages)
    assert quality(outputs).gave_up == 4
    assert correction(outputs).pairs == 8


def test_reports_before_the_first_navigation_are_flagged() -> None:
    scene = two_ships(8)
    said = [m for m in scene.said(1) if m.carrier == "a" or m.stream != "navigation"]
    _, outputs = pipeline.step(scene.initial(), closed(1, said), said)
    assert of_radar(outputs, "b").logs == 8
    assert of_radar(outputs, "b").flag == "no navigation of b yet: not used"


def test_three_carriers_make_one_target_of_their_logs() -> None:
    scene = two_ships(5)
    c = Ship("c", at_m=(-7000.0, 5000.0), position_error_m=(900.0, 100.0))
    scene = replace(scene, ships=(*scene.ships, c))
    _, outputs = scene.run(1, np.random.default_rng(1))
    targets = association(outputs[0]).targets
    assert [target.logs for target in targets] == [
        [f"{name}/1/radar/1/{i}" for name in "abc"] for i in range(5)
    ]
    assert association(outputs[0]).alone == {"a": 0, "b": 0, "c": 0}


def test_slow_sources_repeat_the_last_correction_between_reports() -> None:
    scene = replace(two_ships(8), period_steps=3)
    _, outputs = scene.run(6, np.random.default_rng(1))
    found = [correction(out) for out in outputs]
    assert [c.valid_t_ns for c in found] == [stamp(s) for s in (1, 1, 1, 4, 4, 4)]
    assert found[0].own_axes == found[2].own_axes
    assert found[2].own_axes != found[3].own_axes
    assert [c.reason[-12:] for c in found[:3]] == ["of 3 reports"] * 3


def test_targets_are_counted_once_however_many_registrations_meet_them() -> None:
    """b is paired with the log of a before it, c with the one after it, in one Closed."""
    scene = two_ships(5, fusion=CLOSED_FORM)
    a, b = scene.ships
    c = Ship("c", at_m=(-7000.0, 5000.0), looks_before_s=0.3)
    scene = replace(scene, ships=(a, replace(b, looks_before_s=0.7), c))
    _, outputs = scene.run(3, np.random.default_rng(1))
    assert correction(outputs[-1], "b").valid_t_ns == stamp(2.3)
    assert correction(outputs[-1], "c").valid_t_ns == stamp(3)
    assert [target.logs for target in association(outputs[-1]).targets] == [
        [f"a/1/radar/3/{i}", f"b/1/radar/3/{i}", f"c/1/radar/3/{i}"] for i in range(5)
    ]
    assert [of_radar(outputs[-1], name).associated for name in "abc"] == [5, 5, 5]
    assert association(outputs[-1]).alone == {"a": 0, "b": 0, "c": 0}
