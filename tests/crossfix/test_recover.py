"""`recover`: a torn recording is whole afterwards, and says what became of it."""

import json
from pathlib import Path

import pytest

from schemas.recording.reader import open_recording
from tests.crossfix.conftest import Crossfix
from tests.crossfix.remade import everything
from tests.crossfix.small_recording import record, record_torn


@pytest.fixture
def torn(tmp_path: Path) -> Path:
    record_torn(tmp_path / "torn.mcap")
    return tmp_path / "torn.mcap"


def test_in_place(torn: Path, crossfix: Crossfix) -> None:
    before = everything(torn)
    shown = crossfix("recover", torn)
    assert shown.code == 0, shown
    assert f"{len(before)} messages, 0 of them out of a torn chunk" in shown.out
    assert everything(torn) == before
    assert crossfix("verify", torn, "--refuse").code == 0
    assert "nothing to do" in crossfix("recover", torn).out


def test_into_a_new_file(torn: Path, tmp_path: Path, crossfix: Crossfix) -> None:
    old, new = torn.read_bytes(), tmp_path / "new.mcap"
    facts = json.loads(crossfix("recover", torn, "-o", new, "--json").out)
    assert facts["was_whole"] is False
    assert facts["bytes_after"] == new.stat().st_size
    assert torn.read_bytes() == old
    assert everything(new) == everything(torn)
    assert crossfix("recover", torn, "-o", new).code == 2  # nothing is overwritten


def test_damage_within_is_told_by_the_exit_code(tmp_path: Path, crossfix: Crossfix) -> None:
    path, new = tmp_path / "bad.mcap", tmp_path / "new.mcap"
    record(path)
    with open_recording(path) as recording:
        (span,) = recording.index.spans
    data = bytearray(path.read_bytes())
    data[(span.offset + span.end) // 2] ^= 1
    path.write_bytes(data)
    shown = crossfix("recover", path, "-o", new)
    assert shown.code == 1
    assert "lost: " in shown.out


def test_what_cannot_be_recovered(tmp_path: Path, crossfix: Crossfix) -> None:
    path = tmp_path / "no.mcap"
    path.write_text("not MCAP")
    for bad in (path, tmp_path, tmp_path / "none"):
        shown = crossfix("recover", bad)
        assert shown.code == 2
        assert len(shown.err.splitlines()) == 1
