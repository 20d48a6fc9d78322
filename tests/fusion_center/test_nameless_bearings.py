"""What targets of bearings are called, and which pairs of nameless ones stand out."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from bench.in_process import played
from fusion_center.passive.frames import _is_due
from fusion_center.passive.naming import is_nameless, names, target_of, with_nameless
from fusion_center.passive.pairing import _sure
from fusion_center.state import Paired, Rays, State
from schemas.messages import SourceReport
from sim_world.scenario import load_scenario
from tests.golden.make import SCENARIOS


@pytest.fixture(scope="module")
def met() -> tuple[State, SourceReport]:
    """A state after some looks, and the picket's last report."""
    scenario = load_scenario(SCENARIOS / "passive.toml", {"time.step_s": 15})
    last = list(played(scenario, steps=3))[-1]
    reports = [m for m in last.said if isinstance(m, SourceReport) and m.carrier == "picket"]
    return last.state, reports[-1]


def test_an_identity_is_common_and_a_number_its_carriers_own(
    met: tuple[State, SourceReport],
) -> None:
    state, report = met
    named = names(state, report)
    assert not any(map(is_nameless, named))
    assert [target_of(state, "picket", name) for name in named] == named
    numbered = names(state, replace(report, identity=None, track_id=["7"] * len(report)))
    assert numbered == ["#sonar/track 7"] * len(report)
    assert target_of(state, "picket", numbered[0]) == "picket/#sonar/track 7"
    assert target_of(state, "hunter", numbered[0]) == numbered[0]


def test_bearings_without_anything_are_told_apart_and_once(
    met: tuple[State, SourceReport],
) -> None:
    state, report = met
    bare = replace(report, identity=None, seq=report.seq + 1)
    assert names(state, bare) == [""] * len(bare)
    first = with_nameless(state, bare)
    assert len(set(names(first, bare))) == len(bare)
    later = replace(bare, seq=bare.seq + 1, t_ns=bare.t_ns + 15_000_000_000)
    second = with_nameless(first, later)
    assert names(second, later) == names(first, bare)
    assert names(second, bare) == [""] * len(bare)
    assert with_nameless(second, bare) is second


def test_a_pair_is_called_as_the_own_carrier_calls_it_once_it_counts(
    met: tuple[State, SourceReport],
) -> None:
    state, _ = met
    for agreed, called in ((2, "picket/#sonar/bearing 4"), (3, "#sonar/bearing 1")):
        pair = Paired(target="#sonar/bearing 1", agreed=agreed)
        known = replace(state, paired={"picket/#sonar/bearing 4": pair})
        assert target_of(known, "picket", "#sonar/bearing 4") == called


def test_only_what_stands_out_in_its_row_and_its_column_is_a_pair() -> None:
    table = np.array([[2.0, -20, -20], [-20, 1.0, -2.0], [-20, -20, -9.0]])
    assert _sure(table) == [(0, 0)]
    table[1, 2] = -6.0
    assert _sure(table) == [(0, 0), (1, 1)]
    assert not _sure(np.full((1, 1), -9.0))
    assert not _sure(np.zeros((2, 2)))


def test_one_common_target_that_has_ended_does_not_hold_up_the_others(
    met: tuple[State, SourceReport],
) -> None:
    """An attempt is due when those that nothing joins yet have news."""
    state, report = met
    now, tried = report.t_ns + 60_000_000_000, report.t_ns + 1
    link = replace(state.links["picket"], bearings_t_ns=tried)
    rays = state.rays["hunter/name/uniform"]
    grown = Rays(t_ns=now - 10**9 * np.arange(4, 0, -1), seen=np.repeat(rays.seen[:1], 4, axis=0))
    old = replace(grown, t_ns=grown.t_ns - 70 * 10**9)
    common = {f"{name}/name/uniform": old for name in ("hunter", "picket")}
    fresh = {f"{name}/#sonar/bearing 1": grown for name in ("hunter", "picket")}
    for known, due in ((common, False), (common | fresh, True)):
        later = replace(state, links={"picket": link}, rays=known)
        assert _is_due(later, "picket", now) == due
