"""The Python interface: typed messages, columns of numpy, and data frames where they are wanted."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

import crossfix as api
from crossfix.columns import columns_of, rows_of
from schemas import keys
from schemas import messages as m
from tests.crossfix.remade import remade
from tests.crossfix.small_recording import CORRECTION, STEPS, record, record_torn

ENVELOPE = {"centre": "fusion", "seq": 1, "step": 2, "t_ns": 3}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    record(tmp_path / "small.mcap")
    return tmp_path / "small.mcap"


def test_messages_come_by_their_type(path: Path) -> None:
    with api.open_recording(path) as recording:
        corrections = list(recording.read(m.Correction))
        assert all(isinstance(c, m.Correction) for c in corrections)
        assert [c.step for c in corrections] == list(range(1, STEPS + 1))
        assert list(recording.read("correction")) == corrections
        assert list(recording.read(keys.CORRECTION, carrier="b")) == corrections
        assert list(recording.read("correction", carrier="nobody")) == []
        reports = [r.carrier for r in recording.read(m.SourceReport, carrier="a", source="radar")]
        assert reports == ["a"] * STEPS


def test_a_report_is_a_row_for_each_log(path: Path) -> None:
    with api.open_recording(path) as recording:
        reports = list(recording.read(m.SourceReport, carrier="b"))
        logs = recording.columns("report", carrier="b")
    assert logs.rows == sum(map(len, reports))
    np.testing.assert_array_equal(
        logs["bearing_rad"], np.concatenate([report.bearing_rad for report in reports])
    )
    assert logs["t_ns"].dtype == np.int64
    assert set(logs["carrier"]) == {"b"}
    assert next(iter(logs)) == "log_time_ns"


def test_a_correction_is_a_row_with_dotted_names(path: Path) -> None:
    with api.open_recording(path) as recording:
        corrections = list(recording.read(m.Correction))
        columns = recording.columns(m.Correction)
    last = corrections[-1]
    assert columns["own_axes.east_m"][-1] == last.own_axes.east_m
    triangle = [columns[f"own_axes.covariance.{n}"][-1] for n in range(6)]
    assert triangle == last.own_axes.covariance
    known = [c.own_axes is not None for c in corrections]
    assert list(~np.isnan(columns["own_axes.east_m"])) == known
    assert columns["state"].tolist() == [c.state for c in corrections]


def test_a_picture_is_a_row_for_each_track() -> None:
    track = m.Track(
        id="t1", position_m=[1.0, 2.0], velocity_mps=[3.0, 4.0], covariance=[1.0, 0.0, 1.0],
        existence=0.9, classes={"ferry": 0.75}, carriers=["a", "b"],
    )  # fmt: skip
    tracks = m.Tracks(**ENVELOPE, tracks=[track, replace(track, id="t2")])
    columns = columns_of(rows_of(tracks))
    assert columns.rows == 2
    assert columns["tracks.id"].tolist() == ["t1", "t2"]
    assert columns["tracks.position_m.1"].tolist() == [2.0, 2.0]
    assert columns["tracks.classes.ferry"].tolist() == [0.75, 0.75]
    assert columns["tracks.carriers"].tolist() == ['["a", "b"]'] * 2
    assert columns["step"].tolist() == [2, 2]


def test_true_targets_are_rows_and_features_columns() -> None:
    truth = m.TruthTargets(
        boot="w", seq=1, step=1, t_ns=1, number=[7, 9], position_m=[[1.0, 2.0, 3.0]] * 2,
        velocity_mps=[[0.0] * 3] * 2, acceleration_mps2=[[0.0] * 3] * 2,
        features={"length": [10.0, 20.0]},
    )  # fmt: skip
    columns = columns_of(rows_of(truth))
    assert columns["number"].tolist() == [7, 9]
    assert columns["position_m.2"].tolist() == [3.0, 3.0]
    assert columns["features.length"].tolist() == [10.0, 20.0]


def test_what_is_absent_is_nan_or_empty_and_integers_stay_exact() -> None:
    columns = columns_of(
        [{"i": 2**60 + 1, "x": 1.0, "b": True}, {"i": 2**60 + 3, "s": "a", "n": 5, "b": False}]
    )
    assert columns["i"].tolist() == [2**60 + 1, 2**60 + 3]
    np.testing.assert_array_equal(columns["x"], [1.0, np.nan])
    np.testing.assert_array_equal(columns["n"], [np.nan, 5.0])
    assert columns["s"].tolist() == ["", "a"]
    assert columns["b"].dtype == bool
    large = columns_of([{"i": 2**60 + 1}, {}])
    assert large["i"].tolist() == [2**60 + 1, None]
    assert columns_of([]).rows == 0


def test_what_cannot_be_read_is_passed_over_and_counted(path: Path) -> None:
    def spoil(message):
        bad = (message.key, message.sequence) == (CORRECTION, 2)
        return [message._replace(payload=b"\xc1")] if bad else [message]

    bad = remade(path, path.with_name("bad.mcap"), spoil)
    with api.open_recording(bad) as recording:
        assert [c.seq for c in recording.read("correction")] == [1, 3, 4, 5, 6]
        assert recording.unreadable == 1


def test_a_torn_recording_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    record_torn(tmp_path / "torn.mcap")
    with api.open_recording(tmp_path / "torn.mcap") as recording:
        assert "unfinished" in recording.condition
        assert recording.columns("correction").rows == STEPS


def test_wrong_names_are_one_error(path: Path) -> None:
    with api.open_recording(path) as recording:
        with pytest.raises(api.CrossfixError, match="one of scenario"):
            list(recording.read("reports"))
        with pytest.raises(api.CrossfixError, match="no such id"):
            list(recording.read("report", ship="a"))


@pytest.mark.parametrize(("library", "convert"), [("pandas", "to_pandas"), ("polars", "to_polars")])
def test_data_frames_where_they_are_installed(
    library: str, convert: str, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with api.open_recording(path) as recording:
        columns = recording.columns("correction")
    try:
        __import__(library)
    except ImportError:
        pass
    else:
        frame = getattr(columns, convert)()
        assert list(frame.columns) == list(columns)
        assert len(frame) == columns.rows
    monkeypatch.setitem(sys.modules, library, None)  # as if it were not installed
    with pytest.raises(api.CrossfixError, match=f"pip install {library}"):
        getattr(columns, convert)()


def test_refuse_and_diff_are_functions_too(path: Path, tmp_path: Path) -> None:
    new = tmp_path / "new.mcap"
    with api.open_recording(path) as old:
        refused = api.refuse(old, new, {"registration.method": "adjustment"})
        assert refused.steps == STEPS
        with api.open_recording(new) as made:
            found = api.diff(old, made)
    assert not found.is_same
    assert [change.name for change in found.settings] == ["registration.method"]


def test_the_names_do_not_depend_on_what_was_imported_before() -> None:
    """A module of the name of a function would hide it."""
    program = (
        "import crossfix.commands.diff, crossfix.commands.refuse, crossfix.differences, crossfix\n"
        "assert callable(crossfix.diff) and callable(crossfix.refuse) and callable(crossfix.cut)"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)
