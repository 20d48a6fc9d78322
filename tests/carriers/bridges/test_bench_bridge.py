"""The benchmark of the bridge runs, and every line it sends is published."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest


@pytest.mark.live
def test_the_bench_runs_small() -> None:
    command = [sys.executable, "-m", "bench.bridge", "--runs", "1", "--json", "--seed", "3"]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    figures = {figure["name"]: figure for figure in json.loads(done.stdout)["figures"]}
    assert figures["lines of JSON to the bus, scaled"]["demand"] == ">= 20000"
    assert figures["lines of JSON to the bus, scaled"]["value"] > 1000
    assert figures["time of a line / without us and unchecked"]["value"] > 1
