"""Alignment against the truth: what is told rightly has no error, and clocks count from own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from crossfix.evaluation import (
    AlignmentError,
    alignment_errors,
    summarise_alignment,
    summarise_beacons,
    true_beacons_m,
)
from crossfix.report.figures import Figures
from crossfix.report.writing import write_page
from crossfix.table import show_results
from schemas.bus.memory_bus import MemoryNetwork
from schemas.messages import (
    AlignedBeacon,
    AlignedCarrier,
    Alignment,
    DeclaredScenario,
    TruthCarriers,
)
from sim_world.scenario import Scenario, load_scenario
from tests.whole.in_memory import MemoryRun

BEACONS = Path(__file__).parents[2] / "scenarios" / "beacons.toml"
NORTH_RAD, LATE_S = (0.01, -0.02), (0.3, -0.2)
PLACE_M = ((100.0, 200.0), (-3000.0, 500.0))
VELOCITY_MPS = (10.0, -4.0)
TRIANGLE = [4.0, 0.0, 9.0]


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario(BEACONS, {"time.duration_s": 60})


@pytest.fixture(scope="module")
def recording(scenario: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("aligned") / "beacons.mcap"
    MemoryRun(scenario, MemoryNetwork(), path).carry_out()
    return path


@pytest.fixture(scope="module")
def declared(scenario: Scenario) -> DeclaredScenario:
    return scenario.declared


def truth(t_ns: int) -> TruthCarriers:
    return TruthCarriers(
        boot="w", seq=1, step=1, t_ns=t_ns, carrier=["own", "other"],
        position_m=[[*place, 0.0] for place in PLACE_M],
        velocity_mps=[[*VELOCITY_MPS, 0.0]] * 2, acceleration_mps2=[[0.0] * 3] * 2,
        heading_rad=[0.0, 0.0], north_error_rad=[*NORTH_RAD], clock_offset_s=[*LATE_S],
    )  # fmt: skip


def told_rightly(declared: DeclaredScenario) -> Iterator[Alignment]:
    """By each carrier's own clock, which shows the instant of the truth that much later."""
    t_ns = declared.epoch_ns + declared.step_ns
    for number, name in enumerate(("own", "other")):
        carrier = AlignedCarrier(
            carrier=name, status="determined", t_ns=t_ns + round(LATE_S[number] * 1e9),
            position_m=[*PLACE_M[number]], covariance=TRIANGLE,
            current_mps=[0.0, 0.0], current_covariance=[0.0] * 3,
            north_rad=NORTH_RAD[number], sigma_north_rad=0.001,
            stamp_s=LATE_S[number] - LATE_S[0], sigma_stamp_s=0.01 * number,
        )  # fmt: skip
        yield Alignment(centre="fusion", seq=1, step=1, t_ns=t_ns, carriers=[carrier])


def errors_of(declared: DeclaredScenario, told: list[Alignment]) -> dict[str, list[AlignmentError]]:
    return alignment_errors(declared, "own", [*told, truth(declared.epoch_ns + declared.step_ns)])


def test_what_is_told_rightly_has_no_error(declared: DeclaredScenario) -> None:
    found = errors_of(declared, [*told_rightly(declared)])
    assert sorted(found) == ["other", "own"]
    for (error,) in found.values():
        assert error.found_m == pytest.approx((0, 0), abs=1e-6)  # a nanosecond at 10 m/s
        assert error.nees == pytest.approx(0, abs=1e-9)
        assert error.found_rad == pytest.approx(0)
        assert error.found_s == pytest.approx(0)
        assert error.sigma_m == (2.0, 3.0)


def test_an_error_is_told_less_true_and_weighed_by_its_covariance(
    declared: DeclaredScenario,
) -> None:
    *_, told = told_rightly(declared)
    (carrier,) = told.carriers
    east, north = carrier.position_m
    astray = replace(
        carrier, position_m=[east + 2, north - 3], north_rad=carrier.north_rad + 0.001,
        stamp_s=carrier.stamp_s + 0.02,
    )  # fmt: skip
    (error,) = errors_of(declared, [replace(told, carriers=[astray])])["other"]
    assert error.found_m == pytest.approx((2, -3), abs=1e-6)
    assert error.nees == pytest.approx(2, abs=1e-5)  # one sigma along each axis
    assert error.found_rad == pytest.approx(0.001)
    assert error.found_s == pytest.approx(0.02)
    assert error.reported_rad == -NORTH_RAD[1]
    assert error.reported_s == pytest.approx(LATE_S[0] - LATE_S[1])
    summary = summarise_alignment([error], astray)
    assert summary.found_m == pytest.approx(np.hypot(2, 3), abs=1e-5)
    assert summary.nees_per_dimension == pytest.approx(1, abs=1e-5)


def test_a_carrier_of_which_the_truth_knows_nothing_has_no_errors(
    declared: DeclaredScenario,
) -> None:
    told, _ = told_rightly(declared)
    stranger = replace(told, carriers=[replace(told.carriers[0], carrier="stranger")])
    assert errors_of(declared, [stranger]) == {}


def test_beacons_are_held_against_where_they_truly_are(scenario: Scenario) -> None:
    true_m = true_beacons_m(scenario.truth)
    assert sorted(true_m) == ["east", "west"]
    told = [
        AlignedBeacon(
            beacon=name,
            position_m=np.add(place, (3, 4, 12)).tolist(),
            covariance=[1, 0, 0, 4, 0, 4],
        )
        for name, place in true_m.items()
    ]
    last = Alignment(centre="fusion", seq=1, step=1, t_ns=0, beacons=told)
    for found in summarise_beacons(scenario.declared, last, true_m):
        assert found.found_m == pytest.approx(13)
        assert found.sigma_m == pytest.approx(3)
        assert 10 < found.declared_m < 200  # drawn from 50 m in each of three directions
    surveyed = [replace(beacon, covariance=[0.0] * 6) for beacon in told]
    assert summarise_beacons(scenario.declared, replace(last, beacons=surveyed), true_m) == []
    unknown = summarise_beacons(scenario.declared, last, true_beacons_m(None))
    assert all(np.isnan(found.found_m) for found in unknown)


def test_a_run_of_one_carrier_with_beacons_is_told_and_drawn(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    show_results(recording)
    shown = capsys.readouterr().out
    assert "Carriers by beacons and ranges" in shown
    assert "Beacons at the end" in shown
    assert "correction" not in shown  # there is nobody to be corrected, and nothing to be tracked
    assert "GOSPA" not in shown
    figures, page = drawn(recording)
    (helicopter,) = figures.alignment
    assert helicopter.found_m < 4 * helicopter.sigma_m
    assert {beacon.beacon for beacon in figures.beacons} == {"east", "west"}
    assert "Carriers by beacons and ranges" in page
    assert "No correction was found" not in page


def drawn(recording: Path) -> tuple[Figures, str]:
    page = recording.with_suffix(".html")
    return write_page(recording, page), page.read_text(encoding="utf-8")
