"""A carrier says everything in its corrected frame, and only as long as the correction holds."""

from __future__ import annotations

from math import radians

import pytest

from carriers.carrier import Carrier, Outgoing, Stamp
from carriers.feedback import MOST_KEPT, Corrections, Newest
from schemas import codec
from schemas.feedback import WINDOW, uncorrected
from schemas.messages import (
    Correction,
    Feedback,
    Input,
    Navigation,
    Pose,
    Ranging,
    SourceReport,
)
from sim_world.scenario import Scenario
from sim_world.world import World
from tests.sim_world.scenes import Tree, carrier, radar, scenario, target

FEEDBACK = Feedback(
    latitude_rad=1e-4,
    longitude_rad=-2e-4,
    north_rad=radians(2),
    covariance=[25.0, 0.0, 0.0, 36.0, 0.0, 1e-6],
)
PRIOR: Tree = {"sigma_position_m": 900.0, "sigma_north_deg": 2.0, "sigma_clock_s": 0.2}


def made(**navigation: object) -> Scenario:
    """A carrier with plots, tracks of both kinds, and ranges; its clock is wrong."""
    sensors = [
        radar(name="plots", clutter_per_scan=2.0),
        radar(name="tracks", tracking={"report": "track"}),
        radar(name="gains", tracking={"report": "increment"}),
    ]
    ranging = [{"kind": "two_way", "to": ["other"], "sigma_m": 5.0}]
    own = carrier("own", *sensors, navigation=PRIOR | navigation, ranging=ranging)
    return scenario([own, carrier("other")], targets=[target("t")])


def correction(step: int, t_ns: int, **more: object) -> Correction:
    fields = {"state": "applied", "valid_t_ns": t_ns, "feedback": FEEDBACK} | more
    return Correction(
        centre="fusion", seq=step, step=step, t_ns=t_ns, carrier="own",
        id=f"fusion/own/{step}", **fields,
    )  # fmt: skip


def told(made: Scenario, corrections: dict[int, Correction], steps: int = 12) -> list[Outgoing]:
    world, teller, stamp = World(made), Carrier(made, "own"), Stamp("b1")
    return [
        out
        for k in range(1, steps + 1)
        for out in teller.step(*world.step(k), stamp, corrections.get(k))
    ]


def always(made: Scenario, steps: int = 12) -> dict[int, Correction]:
    epoch, step = made.declared.epoch_ns, made.declared.step_ns
    return {k: correction(k - 1, epoch + k * step) for k in range(3, steps + 1)}


def test_all_it_says_is_what_it_would_say_but_for_the_correction() -> None:
    plain, fed = told(made(), {}), told(made(), always(made()))
    assert len(plain) == len(fed)
    kinds = set()
    for one, other in zip(plain, fed, strict=True):
        said, own = other.message, one.message
        assert isinstance(said, Input)
        codec.decode(one.topic.message, codec.encode(said))
        if said.step >= 3 and isinstance(said, Navigation | SourceReport):
            assert said.correction_id == f"fusion/own/{said.step - 1}"
            kinds.add(said.stream)
        else:
            assert said == own
        back = uncorrected(said)
        if isinstance(back, Navigation | Ranging):
            assert back == own
        elif isinstance(back, SourceReport):
            assert isinstance(own, SourceReport)
            assert back.bearing_rad == pytest.approx(own.bearing_rad, abs=1e-12)
            assert back.east_m == pytest.approx(own.east_m, abs=1e-8)
    assert kinds == {"navigation", "plots", "tracks", "gains"}


def test_pose_and_north_are_what_the_correction_makes_them() -> None:
    plain, fed = told(made(), {}), told(made(), always(made()))
    pairs = [
        (one.message, other.message)
        for one, other in zip(plain, fed, strict=True)
        if isinstance(other.message, Navigation) and other.message.step >= 3
    ]
    for own, said in pairs:
        assert isinstance(own, Navigation)
        assert isinstance(said, Navigation)
        assert said.uncorrected == own.pose
        assert said.pose.latitude_rad - own.pose.latitude_rad == pytest.approx(1e-4)
        assert said.pose.longitude_rad - own.pose.longitude_rad == pytest.approx(-2e-4)
        assert said.pose.covariance == FEEDBACK.covariance
        turned = said.pose.heading_rad - own.pose.heading_rad
        assert turned == pytest.approx(radians(2), abs=1e-12)


def test_a_fix_ends_what_was_found_before_it() -> None:
    """Fixes at steps 5 and 10: the correction of step 6 is of before the second."""
    fixing = made(sigma_clock_s=0.0, fix={"period_s": 5.0, "sigma_m": 9.0})
    epoch, step = fixing.declared.epoch_ns, fixing.declared.step_ns
    held = dict.fromkeys(range(3, 13), correction(6, epoch + 6 * step))
    said = [m.message for m in told(fixing, held) if isinstance(m.message, Navigation)]
    assert [m.step for m in said if m.correction_id] == [3, 4, 5, 6, 7, 8, 9]


def test_a_new_life_begins_without_one() -> None:
    epoch, step = made().declared.epoch_ns, made().declared.step_ns
    before, after = correction(4, epoch + 4 * step), correction(9, epoch + 9 * step)
    world, teller, stamp = World(made(sigma_clock_s=0.0)), None, Stamp("b2")
    teller = Carrier(made(sigma_clock_s=0.0), "own")
    held = []
    for k, one in ((6, before), (7, before), (9, after)):
        said = [o.message for o in teller.step(*world.step(k), stamp, one)]
        held += [m.correction_id for m in said if isinstance(m, Navigation)]
    assert held == ["", "", "fusion/own/9"]


# which one


def test_lockstep_waits_for_the_one_of_the_window_before() -> None:
    known = Corrections("own")
    assert known.missing(step=WINDOW, first_step=1) == []
    [(key, first, last)] = known.missing(step=WINDOW + 1, first_step=1)
    assert (key.process, key.stream, first, last) == ("fusion", "correction/fusion/own", 1, 1)
    known.note(correction(2, 0))
    assert known.missing(step=WINDOW + 1, first_step=1)
    known.note(correction(1, 0))
    assert known.missing(step=WINDOW + 1, first_step=1) == []
    assert known.of(WINDOW + 1) == correction(1, 0)
    assert known.missing(step=WINDOW + 2, first_step=1) == []
    assert known.of(WINDOW + 1) is None  # it has been forgotten
    assert known.missing(step=20, first_step=20 - WINDOW + 1) == []
    assert known.missing(step=20, first_step=20 - WINDOW)


def test_else_the_newest_holds_whatever_the_order() -> None:
    known = Corrections("own")
    assert known.newest() is None
    for step in (3, 7, 5):
        known.note(correction(step, 0))
    assert known.newest() == correction(7, 0)
    known.clear()
    assert known.newest() is None


def test_only_so_many_are_kept() -> None:
    known = Corrections("own")
    for step in range(1, 2 * MOST_KEPT):
        known.note(correction(step, 0))
    assert known.newest() == correction(2 * MOST_KEPT - 1, 0)
    assert known.missing(step=MOST_KEPT + WINDOW - 1, first_step=1)


# carriers without steps


def here(t_ns: int, **more: object) -> Navigation:
    """Navigation of a carrier that stands where it stands."""
    fields = {"kind": "fix", "pose": Pose(latitude_rad=0.6, longitude_rad=-0.1)} | more
    return Navigation(
        carrier="own", boot="b", stream="navigation", seq=1, t_ns=t_ns, **fields
    )  # fmt: skip


PLOT = SourceReport(
    carrier="own", boot="b", stream="radar", seq=1, t_ns=9, bearing_rad=[1.0], range_m=[5e3]
)


def test_without_steps_the_newest_is_applied_from_the_first_navigation_on() -> None:
    newest = Newest()
    newest.note(correction(8, 8))
    assert newest.corrected(PLOT) == PLOT
    assert newest.corrected(here(8)) != here(8)
    newest.note(correction(5, 5))
    turned = newest.corrected(PLOT)
    assert isinstance(turned, SourceReport)
    assert (turned.correction_id, turned.turned_rad) == ("fusion/own/8", radians(2))
    assert turned.bearing_rad == pytest.approx([1.0 + radians(2)])
    newest.note(correction(9, 9, state="suspended", feedback=None))
    assert newest.corrected(PLOT) == PLOT
    assert newest.corrected(here(10)) == here(10)


@pytest.mark.parametrize(
    ("again", "holds"),
    [
        pytest.param({}, True, id="fixes that err alike"),
        pytest.param({"correlation_time_s": 60.0}, False, id="a fix that errs anew"),
        pytest.param({"kind": "dead_reckoning", "correlation_time_s": 60.0}, True, id="no fix"),
    ],
)
def test_what_was_found_holds_as_long_as_the_error_does(
    again: dict[str, object], holds: bool
) -> None:
    newest = Newest()
    newest.corrected(here(3))
    newest.note(correction(8, 8))
    said = newest.corrected(here(12, **again))
    assert isinstance(said, Navigation)
    assert bool(said.correction_id) == holds


def test_what_was_found_of_an_earlier_life_is_not_applied() -> None:
    newest = Newest()
    newest.note(correction(8, 8))
    assert newest.corrected(here(9)) == here(9)
