"""The example for users of Stone Soup: what it reads of a recording, how good its tracks are."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from estimation.metrics import gospa_over_time, matched_over_time
from schemas.bus.memory_bus import MemoryNetwork
from sim_world.scenario import parse_scenario
from tests.whole.in_memory import MemoryRun

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "stonesoup_tracking.py"
SCENARIO = ROOT / "tests" / "whole" / "small.toml"
TARGETS, STEPS = 12, 30
DEADLINE_S = 120.0


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stonesoup") / "run.mcap"
    with MemoryNetwork() as network:
        MemoryRun(parse_scenario(SCENARIO.read_text(), SCENARIO.name), network, path).carry_out()
    return path


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("stonesoup_tracking", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("carrier", ["alpha", "bravo"])
def test_what_a_carrier_saw_lies_about_the_truth_as_it_believes_it(
    example: ModuleType, recording: Path, carrier: str
) -> None:
    """A kilometre and a degree off the truth, but only noise off its own idea of it."""
    scene = example.read(str(recording), carrier)
    assert len(scene.scans) == STEPS
    errors = []
    for scan in scene.scans:
        truth = scene.truth.place[scene.truth.step == scan.t_ns]
        assert len(truth) == TARGETS
        distance = np.linalg.norm(scan.place_m[:, None] - truth, axis=-1).min(axis=1)
        errors.append(distance / np.sqrt(np.trace(scan.covariance, axis1=1, axis2=2)))
    # the nearest of the truth is rarely another: squared errors by their trace average to one
    assert np.mean(np.square(np.concatenate(errors))) == pytest.approx(1, abs=0.25)


def test_perfect_tracks_get_perfect_marks(example: ModuleType, recording: Path) -> None:
    truth = example.read(str(recording)).truth
    found = example.marks(truth, truth)
    assert found.siap.completeness == 1
    assert found.gospa.distance.max() == 0


def test_stone_soup_follows_the_targets(example: ModuleType, recording: Path) -> None:
    pytest.importorskip("stonesoup", reason="the extra `bench` is not installed")
    done = subprocess.run(
        [sys.executable, str(EXAMPLE), str(recording)],
        check=True,
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
    )
    assert f"{STEPS} scans" in done.stdout
    (completeness,) = re.findall(r"completeness ([\d.]+)", done.stdout)
    assert float(completeness) > 0.8  # three of thirty steps go by before a track starts
    (accuracy,) = re.findall(r"accuracy (\d+) m", done.stdout)
    assert int(accuracy) < 60


def test_detections_are_all_that_was_seen(example: ModuleType, recording: Path) -> None:
    pytest.importorskip("stonesoup", reason="the extra `bench` is not installed")
    scans = example.read(str(recording)).scans
    given = list(example.detections(scans))
    assert [len(found) for _, found in given] == [len(scan.place_m) for scan in scans]
    times = [when.timestamp() for when, _ in given]
    assert np.diff(times) == pytest.approx(np.diff([scan.t_ns for scan in scans]) * 1e-9, abs=1e-5)


def test_the_truth_is_kept_by_number_over_time(example: ModuleType, recording: Path) -> None:
    truth = example.read(str(recording)).truth
    pairs = matched_over_time(truth, truth, c=10.0)
    np.testing.assert_array_equal(pairs.truth, pairs.estimate)
    assert gospa_over_time(truth, truth, c=10.0).missed_count.sum() == 0
    for number in np.unique(truth.identity):
        way = np.diff(truth.place[truth.identity == number], axis=0)
        assert (np.linalg.norm(way, axis=1) < 40).all()  # 12 m/s at most, a fix may jump the pose
