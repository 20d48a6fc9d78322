"""`info`: what is in the file is what is shown, as a table and as JSON."""

import json
import re
from pathlib import Path

import pytest

from tests.crossfix.conftest import Crossfix
from tests.crossfix.small_recording import REPORT, RUN, STEPS, record, record_torn


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "small.mcap"


def test_json_says_all_of_it(path: Path, crossfix: Crossfix) -> None:
    written = record(path)
    shown = crossfix("info", path, "--json")
    assert shown.code == 0
    facts = json.loads(shown.out)
    assert facts["header"]["run"] == RUN
    assert facts["messages"] == len(written)
    assert facts["bytes"] == path.stat().st_size
    assert facts["duration_s"] == STEPS - 1
    assert facts["end"]["reason"] == "finished"
    channels = {channel["key"]: channel for channel in facts["channels"]}
    assert channels.keys() == {entry.key for entry in written}
    assert channels[REPORT]["role"] == "input"
    assert channels[REPORT]["messages"] == STEPS


def test_the_table_fits_a_terminal(
    path: Path, crossfix: Crossfix, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    record(path)
    shown = crossfix("info", path)
    assert shown.code == 0
    row = next(line.split() for line in shown.out.splitlines() if "report/b/radar" in line)
    assert row == ["report/b/radar", "input", "SourceReport", str(STEPS), "1.20"]
    assert re.search(r"losses +none", shown.out)
    assert "finished" in shown.out


def test_a_torn_recording_says_so_and_shows_the_rest(path: Path, crossfix: Crossfix) -> None:
    record_torn(path)
    shown = crossfix("info", path)
    assert shown.code == 0
    assert "unfinished" in shown.out
    assert "report/b/radar" in shown.out


def test_no_such_file_is_one_line(path: Path, crossfix: Crossfix) -> None:
    shown = crossfix("info", path)
    assert shown.code == 2
    assert shown.err.count("\n") == 1
    assert str(path) in shown.err


def test_a_recording_without_a_message_has_no_time(tmp_path: Path, crossfix: Crossfix) -> None:
    path = tmp_path / "begun.mcap"
    record(path)
    path.write_bytes(path.read_bytes()[:16_500])
    shown = crossfix("info", path)
    assert "0 messages" in shown.out
    assert "no message can be read" in shown.out
    assert "1970" not in shown.out
