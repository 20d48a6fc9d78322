"""`merge` and `cat`: what was taken apart comes together again, each message once."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from schemas.recording.reader import open_recording
from tests.crossfix.conftest import Crossfix
from tests.crossfix.remade import everything, remade, with_field
from tests.crossfix.small_recording import CORRECTION, REPORT, STEPS, record


@pytest.fixture
def path(tmp_path: Path) -> Path:
    record(tmp_path / "small.mcap")
    return tmp_path / "small.mcap"


@pytest.fixture
def new(tmp_path: Path) -> Path:
    return tmp_path / "new.mcap"


def part(path: Path, name: str, wanted) -> Path:
    return remade(path, path.with_name(name), lambda m: [m] if wanted(m) else [])


def by_name(messages):
    return sorted(messages, key=lambda m: (m.log_time_ns, m.key, m.sequence))


def test_two_halves_make_a_whole(path: Path, new: Path, crossfix: Crossfix) -> None:
    one = part(path, "one.mcap", lambda m: m.key == REPORT or m.sequence % 2)
    other = part(path, "other.mcap", lambda m: m.key != REPORT or m.sequence % 2)
    facts = json.loads(crossfix("merge", one, other, "-o", new, "--json").out)
    assert by_name(everything(new)) == by_name(everything(path))
    assert facts["made"]["messages"] + facts["repeated"] == len(everything(one)) + len(
        everything(other)
    )
    assert crossfix("verify", new, "--refuse").code == 0
    with open_recording(new) as recording:
        assert recording.header.made_from == {"verb": "merge", "of": "one.mcap, other.mcap"}


def test_merged_with_itself_it_is_itself(path: Path, new: Path, crossfix: Crossfix) -> None:
    assert crossfix("merge", path, path, "-o", new).code == 0
    assert by_name(everything(new)) == by_name(everything(path))


def test_recordings_that_disagree_are_not_merged(path: Path, new: Path, crossfix: Crossfix) -> None:
    def alter(message):
        if (message.key, message.sequence) == (CORRECTION, 4):
            return [with_field(message, "reason", value="another")]
        return [message]

    other = remade(path, path.with_name("other.mcap"), alter)
    shown = crossfix("merge", path, other, "-o", new)
    assert shown.code == 2
    assert f"{CORRECTION}, seq 4" in shown.err
    assert not new.exists()


def test_recordings_fused_with_other_settings_are_not_merged(
    path: Path, new: Path, crossfix: Crossfix
) -> None:
    other = path.with_name("other.mcap")
    crossfix("refuse", path, "--set", "association.gate=2", "-o", other)
    shown = crossfix("merge", path, other, "-o", new)
    assert shown.code == 2
    assert "other settings" in shown.err


def test_parts_one_behind_the_other(path: Path, new: Path, crossfix: Crossfix) -> None:
    parts = [path.with_name(f"part{n}.mcap") for n in range(3)]
    for n, name in enumerate(parts):
        crossfix("cut", path, "--start", 2 * n, "--until", 2 * n + 2, "-o", name)
    closings = [m for m in everything(path) if "closed/fusion" in m.key]
    shown = crossfix("cat", *parts, "-o", new)
    assert shown.code == 0, shown
    joined = everything(new)
    assert [m for m in joined if m.key == REPORT] == [
        m for m in everything(path) if m.key == REPORT
    ]
    assert len(joined) == len(everything(path))
    assert len([m for m in joined if "closed/fusion" in m.key]) == len(closings)


def test_parts_in_the_wrong_order_are_refused(path: Path, new: Path, crossfix: Crossfix) -> None:
    parts = [path.with_name(f"part{n}.mcap") for n in range(2)]
    crossfix("cut", path, "--until", 3, "-o", parts[0])
    crossfix("cut", path, "--start", 3, "-o", parts[1])
    shown = crossfix("cat", *reversed(parts), "-o", new)
    assert shown.code == 2
    assert "crossfix merge" in shown.err
    assert not new.exists()


def test_lines_of_json_are_the_messages(path: Path, crossfix: Crossfix) -> None:
    shown = crossfix("cat", path, "--keys", "correction/**")
    lines = [json.loads(line) for line in shown.out.splitlines()]
    assert [line["sequence"] for line in lines] == list(range(1, STEPS + 1))
    assert {line["key"] for line in lines} == {CORRECTION}
    assert {line["role"] for line in lines} == {"output"}
    assert lines[-1]["message"]["own_axes"]["east_m"]
    assert len(crossfix("cat", path, path).out.splitlines()) == 2 * len(everything(path))


def test_a_payload_that_is_no_message_is_told(path: Path, crossfix: Crossfix) -> None:
    def spoil(message):
        return [message._replace(payload=b"\xc1")] if message.key == CORRECTION else [message]

    bad = remade(path, path.with_name("bad.mcap"), spoil)
    (line, *_) = crossfix("cat", bad, "--keys", "correction/**").out.splitlines()
    assert "message" not in json.loads(line)
    assert json.loads(line)["refused"]


def test_whoever_reads_may_stop(path: Path) -> None:
    command = f'"{sys.executable}" -m crossfix cat "{path}" "{path}" | head -n 1'
    done = subprocess.run(
        ["/bin/sh", "-c", command], capture_output=True, text=True, timeout=60, check=True
    )
    assert json.loads(done.stdout)["key"]
    assert done.stderr == ""


@pytest.mark.parametrize("arguments", [("merge",), ("merge", "one"), ("cat",)])
def test_too_few_recordings(arguments: tuple, path: Path, new: Path, crossfix: Crossfix) -> None:
    given = [path if a == "one" else a for a in arguments]
    shown = crossfix(*given, "-o", new)
    assert shown.code == 2
    assert len(shown.err.splitlines()) == 1
