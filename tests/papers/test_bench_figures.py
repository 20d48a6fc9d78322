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


def test_of_several_timings_the_shortest_counts() -> None:
    """Neighbours make calls longer, never shorter; the clock is ours here."""
    now_s, waits_s = [0.0], iter([5.0, 2.0, 9.0])

    def busy() -> None:
        now_s[0] += next(waits_s)

    assert seconds(busy, 3, lambda: now_s[0]) == 2.0


def test_a_ratio_is_of_the_shortest_of_each() -> None:
    now_s, waits_s = [0.0], iter([8.0, 2.0, 12.0, 3.0, 40.0, 2.5])

    def busy() -> None:
        now_s[0] += next(waits_s)

    assert time_ratio(busy, busy, 3, lambda: now_s[0]) == 8.0 / 2.0


@pytest.mark.slow
def test_the_bench_runs_small() -> None:
    command = [sys.executable, "-m", "bench.registration", "--runs", "50", "--json", "--seed", "3"]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    printed = json.loads(done.stdout)
    assert set(printed) == {"figures", "machine", "seed"}
    held = {figure["name"]: figure["holds"] for figure in printed["figures"]}
    assert held["dense = O(L), L <= 1000"]
