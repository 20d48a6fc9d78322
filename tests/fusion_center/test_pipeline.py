"""From reports to an applied correction, and what stands in its way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed

from fusion_center import pipeline
from fusion_center.settings import Settings
from schemas.errors import SettingsError
from schemas.messages import Closed
from tests.fusion_center.scenes import (
    CLOSED_FORM,
    association,
    closed,
    correction,
    matrix,
    named,
    of_radar,
    own_axes_score,
    stamp,
    two_ships,
)


def test_own_is_the_first_declared_unless_settings_name_another() -> None:
    scenario = two_ships().scenario()
    assert pipeline.initial(scenario, Settings()).own == "a"
    assert pipeline.initial(scenario, Settings(own="b")).own == "b"
    with pytest.raises(SettingsError, match="a or b"):
        pipeline.initial(scenario, Settings(own="x"))
    with pytest.raises(SettingsError):
        pipeline.initial(changed(scenario, carriers=[]), Settings())


def test_a_correction_comes_about_in_three_reports() -> None:
    _, outputs = two_ships(8).run(4, np.random.default_rng(1))
    found = [correction(out) for out in outputs]
    assert [c.state for c in found] == ["candidate", "candidate", "applied", "applied"]
    assert [c.id for c in found] == [f"fusion/b/{step}" for step in (1, 2, 3, 4)]
    assert found[0].reason == "every direction determined in 1 of 3 reports"
    last = found[-1]
    assert (last.pairs, last.dof, last.valid_t_ns) == (8, 16, stamp(4))
    assert [d.status for d in last.directions] == ["determined"] * 3
    ratios = [d.ratio for d in last.directions]
    assert ratios == sorted(ratios, reverse=True)


def test_fixed_and_own_axes_say_the_same() -> None:
    _, outputs = two_ships(8).run(1, np.random.default_rng(1))
    found = correction(outputs[0])
    own, fixed = found.own_axes, found.fixed_axes
    assert own is not None
    assert fixed is not None
    assert own.rotation_rad == pytest.approx(fixed.c2_rad - fixed.c1_rad, abs=1e-12)
    offset = np.hypot(
        own.reported_east_m + fixed.offset_east_m, own.reported_north_m + fixed.offset_north_m
    )
    assert np.hypot(own.east_m, own.north_m) == pytest.approx(offset)
    own_sigmas = np.sqrt(np.diag(matrix(own.covariance, 3)))
    fixed_sigmas = np.sqrt(np.diag(matrix(fixed.covariance, 4)))
    assert own_sigmas[2] < fixed_sigmas[2]  # the common turn is unobservable in fixed axes only


def test_one_target_leaves_orientation_open() -> None:
    _, outputs = two_ships(1).run(5, np.random.default_rng(1))
    found = correction(outputs[-1])
    assert found.state == "observing"
    assert found.directions[0].status == "undetermined"
    assert found.reason.startswith(found.directions[0].name)


def test_no_common_target_leaves_everything_open() -> None:
    scene = two_ships(8, identities=False, fusion=CLOSED_FORM)
    _, outputs = scene.run(3, np.random.default_rng(1))
    found = correction(outputs[-1])
    assert (found.state, found.reason, found.pairs) == ("observing", "no pair of logs", 0)
    assert found.own_axes is None
    assert association(outputs[-1]).targets == []
    assert association(outputs[-1]).alone == {"a": 8, "b": 8}


def test_wrong_identities_are_noticed() -> None:
    """Names of b shifted by one: no frame fits, and none is applied."""
    scene = two_ships(8)
    state, rng = scene.initial(), np.random.default_rng(1)
    for step in range(1, 6):
        messages = scene.said(step, rng)
        messages = [
            changed(m, identity=[*named(8)[1:], "n0"])
            if m.carrier == "b" and m.stream == "radar"
            else m
            for m in messages
        ]
        state, outputs = pipeline.step(state, closed(step, messages), messages)
        assert correction(outputs).state == "candidate"
        assert "chi2" in correction(outputs).reason
        assert of_radar(outputs, "b").nis > 10


def test_coordinates_pair_only_after_a_correction_is_applied() -> None:
    """Three targets without a name join in at the step after the third."""
    scene = two_ships(11, fusion=CLOSED_FORM)
    scene = replace(scene, identities=[*named(8), None, None, None])
    _, outputs = scene.run(6, np.random.default_rng(1))
    by_coordinates = [
        sum(target.method == "coordinates" for target in association(out).targets)
        for out in outputs
    ]
    assert by_coordinates[:3] == [0, 0, 0]
    assert min(by_coordinates[3:]) >= 2
    for target in association(outputs[-1]).targets:
        one, two = target.logs
        assert one.rpartition("/")[2] == two.rpartition("/")[2]  # the index is the target
    assert own_axes_score(correction(outputs[-1]), scene.truth("b", 6)) < 5.4  # 0.1 % of chi2 3


def test_plots_without_any_name_pair_by_coordinates() -> None:
    """80 % named; the rest are bare plots, with neither identity nor track."""
    scene = two_ships(10)
    state, rng = scene.initial(), np.random.default_rng(1)
    for step in range(1, 6):
        messages = [
            changed(m, track_id=None, identity=[*named(8), None, None])
            if m.stream == "radar"
            else m
            for m in scene.said(step, rng)
        ]
        state, outputs = pipeline.step(state, closed(step, messages), messages)
    assert correction(outputs).pairs == 10


def test_the_estimate_in_force_holds_over_an_empty_report() -> None:
    scene = two_ships(8, fusion=CLOSED_FORM)
    state, outputs = scene.run(4, np.random.default_rng(1))
    before = correction(outputs[-1])
    blind = replace(scene, targets_m=np.zeros((0, 2)), identities=[])
    settings_age_s = state.settings.logs.max_age_s
    late = 4 + round(settings_age_s) + 1  # by then nothing can be carried on any more
    messages = [changed(m, seq=5) if m.stream != "info" else m for m in blind.said(late)]
    state, out = pipeline.step(state, closed(5, messages, t_ns=stamp(late)), messages)
    after = correction(out)
    assert after.state == "applied"
    assert after.reason == "the last good estimate holds: no pair of logs"
    assert (after.own_axes, after.valid_t_ns) == (before.own_axes, before.valid_t_ns)


def test_bearings_only_is_off_with_the_reason() -> None:
    scene = two_ships(8)
    a, b = scene.ships
    scene = replace(scene, ships=(a, replace(b, coordinates="bearing")))
    _, outputs = scene.run(3, np.random.default_rng(1))
    found = correction(outputs[-1])
    assert found.state == "off"
    assert found.reason == "b reports bearings only: no positions to compare"
    assert found.own_axes is None
    assert of_radar(outputs[-1], "b").flag == ""


@pytest.mark.parametrize(
    ("absent", "reason"),
    [
        ({"info", "navigation", "radar"}, "b has not been heard yet"),
        ({"info"}, "no SourceInfo of b yet"),
        ({"navigation"}, "no navigation of b yet"),
    ],
)
def test_off_until_everything_needed_is_known(absent: set[str], reason: str) -> None:
    scene = two_ships(8)
    messages = [m for m in scene.said(1) if m.carrier == "a" or m.stream not in absent]
    _, outputs = pipeline.step(scene.initial(), closed(1, messages), messages)
    assert (correction(outputs).state, correction(outputs).reason) == ("off", reason)


def test_declared_sources_need_no_source_info() -> None:
    scene = two_ships(8)
    scenario = scene.scenario()
    declared = [
        changed(carrier, sources={"radar": scene.ship(carrier.name).properties})
        for carrier in scenario.carriers
    ]
    state = pipeline.initial(changed(scenario, carriers=declared), Settings())
    messages = [m for m in scene.said(1) if m.stream != "info"]
    _, outputs = pipeline.step(state, closed(1, messages), messages)
    assert correction(outputs).pairs == 8


def test_a_stranger_is_registered_by_its_own_covariance() -> None:
    scene = two_ships(8)
    a, b = scene.ships
    x = replace(b, name="x")
    guests = replace(scene, ships=(a, x))
    state = scene.initial()
    messages = guests.said(1, np.random.default_rng(1))
    _, outputs = pipeline.step(state, closed(1, messages), messages)
    assert correction(outputs, "x").state == "off"
    assert correction(outputs, "x").reason.endswith("says how sure its pose is")
    stated = [1500.0**2, 0.0, 0.0, 1500.0**2, 0.0, 0.0175**2]
    messages = [
        changed(m, pose=changed(m.pose, covariance=stated))  # type: ignore[attr-defined]
        if m.carrier == "x" and m.stream == "navigation"
        else m
        for m in messages
    ]
    _, outputs = pipeline.step(state, closed(1, messages), messages)
    assert correction(outputs, "x").pairs == 8
    assert correction(outputs, "b").reason == "b has not been heard yet"


def test_a_surer_pose_gives_a_surer_frame() -> None:
    scene = two_ships(2)
    messages = scene.said(1, np.random.default_rng(1))
    stated = [9.0, 0.0, 0.0, 9.0, 0.0, 1e-8]
    sure = [
        changed(m, pose=changed(m.pose, covariance=stated))  # type: ignore[attr-defined]
        if m.stream == "navigation"
        else m
        for m in messages
    ]
    now = closed(1, messages)
    loose = correction(pipeline.step(scene.initial(), now, messages)[1]).own_axes
    tight = correction(pipeline.step(scene.initial(), now, sure)[1]).own_axes
    assert loose is not None
    assert tight is not None
    assert tight.covariance[0] < 9.0 * 2 + 1
    assert loose.covariance[0] > 20 * tight.covariance[0]


def test_a_pose_that_already_holds_a_correction_is_not_corrected_again() -> None:
    scene = two_ships(8)
    messages = [
        changed(m, correction_id="b-7") if m.carrier == "b" and m.stream == "navigation" else m
        for m in scene.said(1)
    ]
    _, outputs = pipeline.step(scene.initial(), closed(1, messages), messages)
    assert correction(outputs).state == "suspended"
    assert "b-7" in correction(outputs).reason


def test_old_navigation_suspends() -> None:
    scene = two_ships(8)
    state, _ = scene.run(4, np.random.default_rng(1))
    _, outputs = pipeline.step(state, Closed(step=5, t_ns=stamp(50)), [])
    assert correction(outputs).state == "suspended"
    assert correction(outputs).reason == "the navigation of a is 46 s old"


# when


def test_reports_that_alternate_pair_with_the_nearer_neighbour() -> None:
    """Ship b looks 0.7 s before a: its next report, 0.3 s after a's, is the better company."""
    scene = two_ships(8, fusion=CLOSED_FORM)
    a, b = scene.ships
    scene = replace(scene, ships=(a, replace(b, looks_before_s=0.7)))
    _, outputs = scene.run(4, np.random.default_rng(1))
    found = [correction(out) for out in outputs]
    assert found[0].own_axes is None
    assert [c.valid_t_ns for c in found[1:]] == [stamp(step - 0.7) for step in (2, 3, 4)]


def test_a_report_that_is_overdue_is_not_waited_for() -> None:
    """b looks once, 0.7 s before a, and never again: at 1 s its next is awaited, at 2 s no more."""
    scene = two_ships(8, fusion=CLOSED_FORM)
    a, b = scene.ships
    scene = replace(scene, ships=(a, replace(b, looks_before_s=0.7)))
    state, reasons = scene.initial(), []
    for step in (1, 2):
        messages = [m for m in scene.said(step) if m.carrier == "a" or step == 1]
        state, outputs = pipeline.step(state, closed(step, messages), messages)
        reasons.append(correction(outputs).reason)
    assert reasons == ["nothing to compare yet", "no pair of logs"]  # too old to be carried on
