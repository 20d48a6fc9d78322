"""The bench of papers 003 and 004 in small: figures that do not rest on many runs hold."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

SURE = (
    "eqs 8, 9 against the matrix filter",
    "benchmark S, centralised: 2 sigma_r at 600 s",
    "benchmark S, exact one-way: 2 sigma_r at 600 s",
    "split intersection: true by believed, largest ever",
    "figure 3: ideal < correlated < uncorrelated",
    "MAP, ranges: failures",
    "MAP, ranges: mirrors",
    "MAP, differences: failures",
    "LS, differences n=150: diverged",
    "system: failures",
    "system: log clock",
)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_bench_runs_small() -> None:
    command = [sys.executable, "-m", "bench.navigation", "--runs", "8", "--json", "--seed", "3"]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=580)
    printed = json.loads(done.stdout)
    held = {figure["name"]: figure["holds"] for figure in printed["figures"]}
    assert {name: held[name] for name in SURE} == dict.fromkeys(SURE, True)
