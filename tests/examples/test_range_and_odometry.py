"""Ranges and odometry of a real vehicle through the same estimator as the paper's helicopter."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.io import savemat

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "range_and_odometry.py"
PLAZA = ROOT.parent / "shared" / "data" / "real" / "plaza1.mat.gz"


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("range_and_odometry", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.skipif(not PLAZA.exists(), reason="the recorded drive is not beside the project")
def test_beacons_of_the_recorded_drive(example: ModuleType) -> None:
    drive = example.read(PLAZA)
    found = example.survey(drive)
    told = example.compared(found, drive)
    assert found.status == "solved"
    assert told.beacon_errors_m.max() < 0.6  # the ranges themselves scatter by as much
    assert told.path_rmse_m < 0.4
    assert told.reckoned_rmse_m > 1.5
    assert 0.2 < told.nees < 2.2  # 8 coordinates once: 99 % of a chi-squared of 8
    # 6.4 to 6.8 % by the reading, which is 6.8 to 7.3 % by the true range
    assert found.theta[4] == pytest.approx(0.07, abs=3 * np.sqrt(found.covariance[4, 4]))
    assert "range scale" not in " ".join(d.name for d in found.undetermined)


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        (None, "cannot be read as a .mat file"),
        ({"DR": np.ones((3, 3))}, "needs a table TD with columns time, from, to, range"),
        ({"DR": np.ones((3, 2))}, "got shape (3, 2)"),
        ({"DR": np.full((3, 3), np.nan)}, "values that are no numbers"),
        ({"DR": np.array([[2.0, 0.0, 0.0], [1.0, 0.0, 0.0]])}, "times must not go back"),
    ],
)
def test_a_file_of_another_form_gives_one_line(
    example: ModuleType,
    tmp_path: Path,
    tables: dict[str, object] | None,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / "drive.mat"
    if tables is None:
        path.write_bytes(b"no such file")
    else:
        savemat(path, tables)
    monkeypatch.setattr(sys, "argv", ["range_and_odometry.py", str(path)])
    with pytest.raises(SystemExit) as ended:
        example.main()
    message = str(ended.value.code)
    assert said in message
    assert "\n" not in message


@pytest.mark.skipif(not PLAZA.exists(), reason="the recorded drive is not beside the project")
@pytest.mark.parametrize("step", [7, 30])
def test_a_drive_with_few_ranges_is_honest(example: ModuleType, step: int) -> None:
    """One range of seven, or of thirty, a tenth of them 10 to 60 m too long."""
    drive = example.read(PLAZA)
    rng = np.random.default_rng(step)
    logs = drive.logs.of(slice(step // 2, None, step))
    late = (rng.random(len(logs.value_m)) < 0.1) * rng.uniform(10, 60, len(logs.value_m))
    found = example.survey(drive._replace(logs=logs._replace(value_m=logs.value_m + late)))
    assert 0.05 < example.compared(found, drive).nees < 3.0  # 8 coordinates once


def test_a_drive_of_our_own_is_read_and_surveyed(example: ModuleType, tmp_path: Path) -> None:
    """A file of the same form, made here: beacons come out, with the scale they were given."""
    rng = np.random.default_rng(1)
    step, count = 0.5, 1200
    time = 100 + step * np.arange(count + 1)
    turn = np.where(np.arange(count) % 200 < 60, 0.05, 0.0) + 0.002
    heading = 0.3 + np.cumsum(turn) - turn / 2
    travel = step * np.column_stack([np.cos(heading), np.sin(heading)])
    places = np.vstack([[0.0, 0.0], np.cumsum(travel, axis=0)])
    beacons = np.array([[3.0, 10.0, 40.0], [7.0, -30.0, 5.0], [8.0, 60.0, -20.0]])
    which = rng.integers(0, 3, count)
    exact = np.linalg.norm(places[1:] - beacons[which, 1:], axis=1)
    measured = 1.05 * exact + 0.5 * rng.standard_normal(count)
    tables = {
        "DR": np.column_stack([time[1:], np.full(count, step), turn]),
        "TD": np.column_stack([time[1:], np.zeros(count), beacons[which, 0], measured]),
        "TL": beacons,
        "GT": np.column_stack([time, places, np.concatenate([[0.3], heading + turn / 2])]),
    }
    savemat(tmp_path / "drive.mat", tables)
    drive = example.read(tmp_path / "drive.mat")
    np.testing.assert_allclose(drive.path.path_m, places[1:], atol=1e-6)
    found = example.survey(drive)
    told = example.compared(found, drive)
    assert found.theta[4] == pytest.approx(0.05, abs=4 * np.sqrt(found.covariance[4, 4]))
    assert told.nees < 3.0
    assert told.beacon_errors_m.max() < 4 * np.sqrt(np.diag(found.covariance).max())
    done = subprocess.run(
        [sys.executable, str(EXAMPLE), str(tmp_path / "drive.mat")],
        check=True,
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=60,
    )
    assert "1200 ranges, solved" in done.stdout
    assert "ranges read long: " in done.stdout
