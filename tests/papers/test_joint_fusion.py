"""Paper 002: its formula and its rule, what the misprints do, the demands in small."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from bench.joint_fusion import instants, pairs, rules, track_logs
from bench.joint_fusion.instants import by_instant


@pytest.mark.parametrize("carrying", instants.RATIOS)
def test_the_formula_of_the_last_measurement_holds(carrying: float) -> None:
    # 200 000 draws: sigma of an rms .0016
    assert instants.monte_carlo_ratio(7, 200_000, carrying) == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("sources", [1, 2, 3])
def test_half_to_three_quarters_is_an_age_and_not_what_is_saved(sources: int) -> None:
    found = by_instant(7, 20_000, sources)
    first = found["age of the first log at the tick"]
    waited = found["waited for the tick after the last"]
    assert first == pytest.approx(sources / (sources + 1), abs=0.01)
    assert waited == pytest.approx(1 / (sources + 1), abs=0.01)


@pytest.mark.parametrize("sources", [1, 2, 3])
def test_manoeuvres_cost_less_at_the_last_measurement(sources: int) -> None:
    found = by_instant(7, 5000, sources)
    assert found["fused at the last, error then"] < 0.6 * found["fused at the tick, error then"]


def test_the_misprint_accepts_half_of_all_different_pairs() -> None:
    found = rules.accepted(7, 100_000, rules.SPARED)
    assert found["printed, two targets"] == pytest.approx(0.5, abs=0.01)
    assert found["corrected, two targets"] == pytest.approx(0.005, abs=0.001)
    assert found["corrected, one target"] > 0.98


def test_near_targets_are_beyond_the_papers_rule() -> None:
    found = rules.accepted(7, 10_000, 1.17)
    assert found["corrected, one target"] == 0


def test_pairs_at_four_sigma() -> None:
    scores = {rule: pairs.measure(7, 12, 4, rule) for rule in pairs.RULES}
    assert scores["ours"].right > 0.98  # demanded .985, judged at full size; 12 scenes: sigma .002
    assert scores["ours"].wrong < 0.013
    assert scores["ours"].right > scores["Mahalanobis"].right + 0.05
    assert scores["ours"].right > scores["paper's rule"].right + 0.2


def test_the_nearer_the_neighbours_the_more_features_are_worth() -> None:
    gained = [
        pairs.measure(7, 6, d, "ours").right - pairs.measure(7, 6, d, "ours without features").right
        for d in (4, 2, 1)
    ]
    assert gained[0] < gained[1] < gained[2]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_demand_in_full(seed: int) -> None:
    score = pairs.measure(seed, 100, 4, "ours")
    assert score.right >= 0.985
    assert score.wrong <= 0.01


def test_tracks_of_tracks_by_increments_are_central_fusion() -> None:
    held = {figure.name: figure.holds for figure in track_logs.figures(7, 100)}
    assert held["increments - central fusion"]
    assert held["covariance intersection: NEES/dim"]


@pytest.mark.slow
def test_the_bench_runs_small() -> None:
    command = [sys.executable, "-m", "bench.joint_fusion", "--runs", "20", "--json"]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    held = {f["name"]: f["holds"] for f in json.loads(done.stdout)["figures"]}
    assert held["increments - central fusion"]
    assert held["covariance intersection: NEES/dim"]
