"""Carriers that apply their corrections change what they say, and nothing that is fused."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import chain

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace as changed

from estimation.frames import Site, rotation_clockwise, target_from_source, yaw_rad
from fusion_center import pipeline
from fusion_center.relative_frames import feedback
from fusion_center.state import Estimate
from schemas.feedback import applied, corrected, own_navigation
from schemas.messages import Correction, Direction, Input, Navigation, SourceReport
from tests.fusion_center.scenes import (
    CLOSED_FORM,
    Scene,
    closed,
    correction,
    matrix,
    of_radar,
    quality,
    stamp,
    two_ships,
)
from tests.fusion_center.test_pipeline_laws import lively, nameless

STEPS, LAG = 10, 3
Held = dict[str, list[Correction]]
Wrong = Callable[[Input], Input]


def told(scene: Scene, step: int, sent: Held, lag: int = LAG) -> list[Input]:
    """What the ships say when all but the first apply the correction of `lag` steps before."""
    said = scene.said(step, np.random.default_rng(step))
    poses = {m.carrier: m for m in said if isinstance(m, Navigation)}
    held = {
        name: applied(known[-lag], poses[name], stamp(0))
        for name, known in sent.items()
        if len(known) >= lag
    }
    return [corrected(message, held.get(message.carrier)) for message in said]


def run(
    scene: Scene, *, with_feedback: bool, spoilt: Wrong = lambda message: message
) -> tuple[list[pipeline.Outputs], list[Input]]:
    """Outputs step by step, and all that was said."""
    state, outputs = scene.initial(), []
    said: list[Input] = []
    sent: Held = {}
    for step in range(1, STEPS + 1):
        messages = [spoilt(m) for m in told(scene, step, sent if with_feedback else {})]
        state, out = pipeline.step(state, closed(step, messages), messages)
        for ship in scene.ships[1:]:
            sent.setdefault(ship.name, []).append(correction(out, ship.name))
        outputs.append(out)
        said += messages
    return outputs, said


def leaves(value: object) -> list[object]:
    """Everything in a message, flat."""
    if isinstance(value, msgspec.Struct):
        return [leaf for part in msgspec.structs.astuple(value) for leaf in leaves(part)]
    if isinstance(value, dict):
        return [leaf for pair in sorted(value.items()) for leaf in leaves(pair)]
    return [leaf for part in value for leaf in leaves(part)] if isinstance(value, list | tuple) \
        else [value]  # fmt: skip


def all_of(outputs: list[pipeline.Outputs]) -> list[object]:
    return [leaf for out in chain.from_iterable(outputs) for leaf in leaves(out.message)]


def words(outputs: list[pipeline.Outputs]) -> list[object]:
    return [leaf for leaf in all_of(outputs) if not isinstance(leaf, float)]


def numbers(outputs: list[pipeline.Outputs]) -> list[float]:
    return [leaf for leaf in all_of(outputs) if isinstance(leaf, float)]


@pytest.mark.parametrize(
    "make",
    [
        lively,
        pytest.param(nameless, marks=pytest.mark.slow),
        lambda: two_ships(fusion=CLOSED_FORM),
    ],
)
def test_feedback_changes_no_estimate(make: Callable[[], Scene]) -> None:
    """Every number of every output, with feedback and without; places to a micrometre."""
    plain, _ = run(make(), with_feedback=False)
    fed, said = run(make(), with_feedback=True)
    assert sum(bool(getattr(m, "correction_id", "")) for m in said) > 6
    assert words(fed) == words(plain)
    assert numbers(fed) == pytest.approx(numbers(plain), rel=1e-6, abs=1e-6)


def test_corrections_that_are_not_taken_out_would_be_counted_twice() -> None:
    """The law above can fail: the same without the names of the corrections."""

    def silent(message: Input) -> Input:
        if isinstance(message, Navigation):
            return changed(message, correction_id="", uncorrected=None)
        if isinstance(message, SourceReport):
            return changed(message, correction_id="", turned_rad=0.0)
        return message

    plain, _ = run(lively(), with_feedback=False)
    fed, _ = run(lively(), with_feedback=True, spoilt=silent)
    one, other = correction(plain[-1]).own_axes, correction(fed[-1]).own_axes
    assert one is None or other is None or abs(one.rotation_rad - other.rotation_rad) > 1e-4


def test_a_corrected_pose_lies_where_the_correction_has_it() -> None:
    """q and D of own axes are what remains to be seen from own pose: all that was wrong is gone."""
    scene = two_ships(12)
    _, outputs = scene.run(6, np.random.default_rng(1))
    found = correction(outputs[-1])
    axes, back = found.own_axes, found.feedback
    assert axes is not None
    assert back is not None
    said = scene.navigation(scene.ship("b"), 6)
    held = applied(found, said, stamp(0))
    assert held is not None
    own = Site(found.own_pose.latitude_rad, found.own_pose.longitude_rad)
    there = Site(held.pose.latitude_rad, held.pose.longitude_rad)
    between = target_from_source(own, there)
    assert between.translation_m[:2] == pytest.approx([axes.east_m, axes.north_m], abs=1e-3)
    raw = Site(said.pose.latitude_rad, said.pose.longitude_rad)
    seen = yaw_rad(target_from_source(own, raw)) + axes.rotation_rad
    assert held.turned_rad + yaw_rad(between) == pytest.approx(seen, abs=1e-12)
    truth = scene.truth("b", 6)
    sigma = np.sqrt(np.diag(matrix(axes.covariance, 3)))
    assert np.abs(between.translation_m[:2] - truth.q_m).max() < 4 * sigma[:2].max()
    assert np.hypot(*scene.ship("b").position_error_m) > 5 * sigma[:2].max()


def test_the_covariance_is_that_of_a_pose() -> None:
    """What the estimated D has too much, the corrected north has too little."""
    scene = two_ships(12)
    found = correction(scene.run(6, np.random.default_rng(1))[1][-1])
    assert found.own_axes is not None
    assert found.feedback is not None
    of_frame, of_pose = matrix(found.own_axes.covariance, 3), matrix(found.feedback.covariance, 3)
    assert of_pose[2, 2] == pytest.approx(of_frame[2, 2])
    assert np.trace(of_pose[:2, :2]) == pytest.approx(np.trace(of_frame[:2, :2]))
    turn = rotation_clockwise(-yaw_rad(target_from_source(
        Site(found.own_pose.latitude_rad, found.own_pose.longitude_rad),
        Site(found.other_pose.latitude_rad, found.other_pose.longitude_rad))))  # fmt: skip
    assert of_pose[:2, 2] == pytest.approx(-turn @ of_frame[:2, 2], rel=1e-3)


def test_a_drift_is_carried_on() -> None:
    scene = two_ships(12)
    found = correction(scene.run(6, np.random.default_rng(1))[1][-1])
    axes = changed(found.own_axes, drift_east_mps=3.0, drift_north_mps=-4.0)
    back = feedback.of(estimate_of(changed(found, own_axes=axes)))
    assert back is not None
    radius_m = 6_371_000.0
    latitude = found.other_pose.latitude_rad
    assert back.latitude_rad_s * radius_m == pytest.approx(-4.0, rel=0.01)
    assert back.longitude_rad_s * radius_m * math.cos(latitude) == pytest.approx(3.0, rel=0.01)


def test_only_what_is_applied_and_wholly_determined_is_fed_back() -> None:
    scene = two_ships(12)
    _, outputs = scene.run(6, np.random.default_rng(1))
    for out in outputs:
        found = correction(out)
        sure = found.state == "applied" and all(
            direction.status == "determined" for direction in found.directions
        )
        assert (found.feedback is not None) == sure
    assert correction(outputs[0]).feedback is None
    found = correction(outputs[-1])
    open_one = changed(found, directions=[Direction(name="x", ratio=0.6, status="weak")])
    assert feedback.of(estimate_of(found)) is not None
    assert feedback.of(estimate_of(open_one)) is None


def test_what_is_not_of_this_planet_is_not_fed_back() -> None:
    found = correction(two_ships(12).run(6, np.random.default_rng(1))[1][-1])
    astray = changed(found.own_axes, east_m=9e8, north_m=9e8)
    back = feedback.of(estimate_of(changed(found, own_axes=astray)))
    assert back is None or math.isfinite(back.latitude_rad)


def estimate_of(found: Correction) -> Estimate:
    shared = set(Estimate.__struct_fields__) & set(Correction.__struct_fields__)
    fields = {name: getattr(found, name) for name in shared}
    return Estimate(**fields | {"directions": tuple(found.directions), "terms": ()})


# strangers and fools


@pytest.mark.parametrize("name", ["fusion/b/99", "fusion/c/1", "b-7", "fusion/b/x", "\x00/b/1"])
def test_a_correction_that_was_never_sent_is_not_believed(name: str) -> None:
    def spoilt(message: Input) -> Input:
        if message.carrier != "b" or not isinstance(message, Navigation | SourceReport):
            return message
        return changed(message, correction_id=name) if message.step > 6 else message

    outputs, _ = run(two_ships(), with_feedback=False, spoilt=spoilt)
    assert correction(outputs[5]).state == "applied"
    assert correction(outputs[-1]).state == "suspended"
    assert correction(outputs[-1]).feedback is None
    rows = {r.source: r for r in quality(outputs[-1]).sources if r.carrier == "b"}
    assert rows["navigation"].unknown_corrections == 1
    assert rows["radar"].unknown_corrections == 1
    assert rows["radar"].logs == 0
    assert "was never sent: not used" in rows["radar"].flag
    assert quality(outputs[-1]).messages == 3  # two of a's, and b's navigation


def test_who_holds_an_unknown_correction_is_not_in_the_picture() -> None:
    """Its reports may name none: where they lie is not known either."""

    def spoilt(message: Input) -> Input:
        wrong = message.carrier == "b" and isinstance(message, Navigation) and message.step > 6
        return changed(message, correction_id="b-7") if wrong else message

    outputs, _ = run(two_ships(), with_feedback=False, spoilt=spoilt)
    before, after = of_radar(outputs[5], "b"), of_radar(outputs[6], "b")
    assert before.taken + before.lone == before.logs == after.logs
    assert (after.taken, after.lone) == (0, 0)


def test_a_known_correction_without_the_pose_before_it_is_not_believed() -> None:
    def spoilt(message: Input) -> Input:
        return changed(message, uncorrected=None) if isinstance(message, Navigation) else message

    outputs, _ = run(two_ships(), with_feedback=True, spoilt=spoilt)
    suspended = next(out for out in outputs if correction(out).state == "suspended")
    row = next(r for r in quality(suspended).sources if r.unknown_corrections)
    assert (row.carrier, row.source) == ("b", "navigation")
    assert "does not say its pose without it" in row.flag


def test_once_the_carrier_stops_its_correction_is_found_again() -> None:
    def spoilt(message: Input) -> Input:
        wrong = message.carrier == "b" and isinstance(message, Navigation) and message.step == 7
        return changed(message, correction_id="fusion/b/99") if wrong else message

    outputs, _ = run(two_ships(), with_feedback=False, spoilt=spoilt)
    assert correction(outputs[6]).state == "suspended"
    assert correction(outputs[-1]).state == "applied"
    assert of_radar(outputs[-1], "b").unknown_corrections == 0


def test_a_late_message_before_a_feedback_changes_no_bit_of_the_end() -> None:
    """One of step 5 comes with step 6: the corrections held by then are taken out all the same."""
    scene = two_ships()
    _, said = run(scene, with_feedback=True)
    steps = {step: [m for m in said if m.step == step] for step in range(1, STEPS + 1)}
    assert any(getattr(m, "correction_id", "") for m in steps[8])

    def ended(late: bool) -> object:
        state = scene.initial()
        kept: list[Input] = []
        for step, messages in steps.items():
            now = [*kept, *messages]
            if late and step == 8:
                kept = [m for m in messages if m.carrier == "b"]
                now = [m for m in messages if m.carrier != "b"]
            elif kept:
                kept = []
            state, out = pipeline.step(state, closed(step, now), now)
        return all_of([[o for o in out if isinstance(o.message, Correction)]])

    assert ended(late=True) == ended(late=False)


# a carrier


def test_a_carrier_drops_what_is_suspended_or_older_than_its_errors() -> None:
    scene = two_ships(12)
    found = correction(scene.run(6, np.random.default_rng(1))[1][-1])
    said = scene.navigation(scene.ship("b"), 6)
    assert applied(found, said, found.valid_t_ns) is not None
    assert applied(found, said, found.valid_t_ns + 1) is None
    assert applied(changed(found, state="suspended"), said, 0) is None
    assert applied(changed(found, feedback=None), said, 0) is None
    assert applied(None, said, 0) is None


def test_a_correction_grows_as_unsure_as_its_drift_makes_it() -> None:
    scene = two_ships(12)
    found = changed(correction(scene.run(6, np.random.default_rng(1))[1][-1]), valid_for_s=10.0)
    assert found.feedback is not None
    said = changed(scene.navigation(scene.ship("b"), 6), t_ns=found.valid_t_ns + 10 * 10**9)
    held = applied(found, said, 0)
    assert held is not None
    assert held.pose.covariance is not None
    now, then = matrix(held.pose.covariance, 3), matrix(found.feedback.covariance, 3)
    assert now[:2, :2] == pytest.approx(2 * then[:2, :2])
    assert now[2, 2] == then[2, 2]
    assert now[:2, 2] == pytest.approx(math.sqrt(2) * then[:2, 2])


def test_a_correction_grows_as_unsure_as_both_ways_make_it() -> None:
    """By the noise of the readings of both carriers since."""
    scene = two_ships(12)
    found = correction(scene.run(6, np.random.default_rng(1))[1][-1])
    noisy = changed(found, feedback=changed(found.feedback, wander_m2_s=1.5), valid_for_s=0.0)
    assert noisy.feedback is not None
    said = changed(scene.navigation(scene.ship("b"), 6), t_ns=found.valid_t_ns + 4 * 10**9)
    held = applied(noisy, said, 0)
    assert held is not None
    assert held.pose.covariance is not None
    grown = matrix(held.pose.covariance, 3) - matrix(noisy.feedback.covariance, 3)
    assert grown == pytest.approx(np.diag([6.0, 6.0, 0.0]), abs=1e-9)


def test_a_pose_at_the_antimeridian_stays_on_the_wire() -> None:
    scene = two_ships(12)
    found = correction(scene.run(6, np.random.default_rng(1))[1][-1])
    said = scene.navigation(scene.ship("b"), 6)
    edge = changed(said, pose=changed(said.pose, longitude_rad=math.pi - 1e-9, heading_rad=6.2))
    back = changed(found.feedback, longitude_rad=1e-4)
    held = applied(changed(found, feedback=back), edge, 0)
    assert held is not None
    assert held.pose.longitude_rad == pytest.approx(-math.pi + 1e-4, abs=1e-8)
    message = corrected(edge, held)
    assert isinstance(message, Navigation)
    assert own_navigation(message) == edge
    pole = changed(said, pose=changed(said.pose, latitude_rad=math.pi / 2))
    north = changed(found.feedback, latitude_rad=1e-3)
    assert applied(changed(found, feedback=north), pole, 0) is None
