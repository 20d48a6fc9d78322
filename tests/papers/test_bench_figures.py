"""The benchmark's own report: verdicts agree with the demands, JSON has what DESIGN 12 says."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from bench.figures import (
    Figure,
    at_least,
    at_most,
    between,
    near,
    options,
    report,
    scaled_seconds,
    seconds,
    table,
    time_ratio,
    told,
)


@pytest.mark.parametrize(
    ("figure", "demand", "holds"),
    [
        (at_most("a", 1.03, 1.03), "<= 1.03", True),
        (at_most("a", 1.04, 1.03), "<= 1.03", False),
        (at_most("a", float("nan"), 1.03), "<= 1.03", False),
        (at_least("a", 499, 500), ">= 500", False),
        (between("a", 0.95, 0.9, 1.1), "in [0.9, 1.1]", True),
        (between("a", 1.2, 0.9, 1.1), "in [0.9, 1.1]", False),
        (near("a", 0.21, 0.2, 0.006), "0.2 +- 0.006", False),
        (told("a", 3), "", None),
    ],
)
def test_a_demand_and_its_verdict(figure: Figure, demand: str, holds: bool | None) -> None:
    assert (figure.demand, figure.holds) == (demand, holds)


def test_a_demand_that_fails_stays_in_the_list(capsys: pytest.CaptureFixture[str]) -> None:
    figures = [at_most("too slow", 2.0, 1.0, "s"), told("of note", 3.0)]
    report(figures, options("a test", 10, ["--json", "--seed", "5"]))
    printed = json.loads(capsys.readouterr().out)
    assert printed["seed"] == 5
    assert printed["machine"]
    assert printed["figures"][0] == {
        "name": "too slow",
        "value": 2.0,
        "unit": "s",
        "demand": "<= 1",
        "holds": False,
    }
    report(figures, options("a test", 10, []))
    text = capsys.readouterr().out
    assert "| too slow | 2 s      | <= 1     | NO    |" in text
    assert "0 of 1 demands hold" in text


def test_tables_are_markdown() -> None:
    assert table(("a", "b"), [("1", "22")]) == "| a | b  |\n| --|--- |\n| 1 | 22 |"


def test_times_are_scaled_by_a_kernel_of_the_same_run() -> None:
    def work() -> float:
        return sum(i * 0.5 for i in range(20_000))

    assert scaled_seconds(work) == pytest.approx(seconds(work), rel=20)
    assert 1.5 < time_ratio(lambda: [work() for _ in range(4)], work) < 8


@pytest.mark.slow
def test_the_bench_runs_small() -> None:
    command = [sys.executable, "-m", "bench.registration", "--runs", "50", "--json", "--seed", "3"]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    printed = json.loads(done.stdout)
    assert set(printed) == {"figures", "machine", "seed"}
    held = {figure["name"]: figure["holds"] for figure in printed["figures"]}
    assert held["dense = O(L), L <= 1000"]
