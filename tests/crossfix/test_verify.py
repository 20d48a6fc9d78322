"""`verify`: what is whole passes, and whatever is spoilt is found and named."""

import json
import random
from collections.abc import Iterable
from pathlib import Path

import pytest
from mcap.writer import Writer
from msgspec.structs import replace

from crossfix.differences import first_difference
from schemas import keys
from schemas.messages import StreamSpan
from schemas.recording.reader import open_recording
from tests.crossfix.conftest import Crossfix
from tests.crossfix.remade import remade
from tests.crossfix.small_recording import (
    CORRECTION,
    REPORT,
    RUN,
    STEPS,
    Entry,
    Spoil,
    record,
    record_torn,
)
from tests.fusion_center.scenes import two_ships

SEED = 20260101
OUTPUTS = sum(map(len, two_ships().run(STEPS)[1]))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "small.mcap"


def lose(key: str, step: int) -> Spoil:
    return lambda entry: [] if (entry.key, entry.step) == (key, step) else [entry]


def test_a_whole_recording_repeats_itself(path: Path, crossfix: Crossfix) -> None:
    record(path)
    shown = crossfix("verify", path, "--refuse")
    assert shown.code == 0, shown
    assert f"{OUTPUTS} outputs, all equal" in shown.out
    facts = json.loads(crossfix("verify", path, "--refuse", "--json").out)
    assert facts["equal"] == OUTPUTS
    assert facts["difference"] is None
    assert facts["missing"] == []


def test_a_lost_input_is_named_and_nothing_is_fused(path: Path, crossfix: Crossfix) -> None:
    record(path, lose(REPORT, step=3))
    for arguments in ((), ("--refuse",)):
        shown = crossfix("verify", path, *arguments)
        assert shown.code == 1
        assert "missing input: b, boot b1, radar, seq 3 to 3" in shown.out
        assert "outputs" not in shown.out


def test_an_input_that_was_given_up_is_not_missing(path: Path, crossfix: Crossfix) -> None:
    span = StreamSpan(carrier="b", boot="b1", stream="radar", first=3, last=3)

    def give_up(entry: Entry) -> Iterable[Entry]:
        if entry.key == keys.CLOSED_FUSION.key(RUN) and entry.step == 3:
            return [entry._replace(message=replace(entry.message, gave_up=[span]))]
        return lose(REPORT, step=3)(entry)

    record(path, give_up)
    assert crossfix("verify", path).code == 0


def test_an_input_that_came_late_after_all_must_be_there(path: Path, crossfix: Crossfix) -> None:
    span = StreamSpan(carrier="b", boot="b1", stream="radar", first=3, last=3)

    def late(entry: Entry) -> Iterable[Entry]:
        if entry.key == keys.CLOSED_FUSION.key(RUN) and entry.step == 3:
            return [entry._replace(message=replace(entry.message, gave_up=[span]))]
        if entry.key == keys.CLOSED_FUSION.key(RUN) and entry.step == 5:
            return [entry._replace(message=replace(entry.message, late=[span]))]
        return lose(REPORT, step=3)(entry)

    record(path, late)
    assert crossfix("verify", path).code == 1


def test_an_altered_output_is_named_by_key_step_and_field(path: Path, crossfix: Crossfix) -> None:
    def alter(entry: Entry) -> Iterable[Entry]:
        if (entry.key, entry.step) == (CORRECTION, 4):
            axes = entry.message.own_axes
            axes = replace(axes, north_m=axes.north_m + 1e-9)
            return [entry._replace(message=replace(entry.message, own_axes=axes))]
        return [entry]

    record(path, alter)
    shown = crossfix("verify", path, "--refuse")
    assert shown.code == 1
    assert f"{CORRECTION}, step 4 differs in own_axes.north_m" in shown.out
    difference = json.loads(crossfix("verify", path, "--refuse", "--json").out)["difference"]
    assert (difference["key"], difference["step"]) == (CORRECTION, 4)
    assert difference["recorded"] - difference["fused"] == pytest.approx(1e-9, rel=1e-2)


def test_the_first_of_several_differences_is_named(path: Path, crossfix: Crossfix) -> None:
    def alter(entry: Entry) -> Iterable[Entry]:
        wrong = entry.key == CORRECTION and entry.step >= 2
        message = replace(entry.message, reason="altered") if wrong else entry.message
        return [entry._replace(message=message)]

    record(path, alter)
    assert f"{CORRECTION}, step 2 differs in reason" in crossfix("verify", path, "--refuse").out


def test_an_output_that_is_not_recorded(path: Path, crossfix: Crossfix) -> None:
    record(path, lose(CORRECTION, step=2))
    shown = crossfix("verify", path, "--refuse")
    assert shown.code == 1
    assert f"{CORRECTION}, step 2 comes out, but is not recorded" in shown.out


def test_an_output_that_does_not_come_out(path: Path, crossfix: Crossfix) -> None:
    def add(entry: Entry) -> Iterable[Entry]:
        if (entry.key, entry.step) == (CORRECTION, STEPS):
            extra = replace(entry.message, seq=STEPS + 1)
            return [entry, entry._replace(message=extra)]
        return [entry]

    record(path, add)
    shown = crossfix("verify", path, "--refuse")
    assert shown.code == 1
    assert f"{CORRECTION}, step {STEPS} is recorded, but does not come out" in shown.out


def test_a_torn_recording_is_compared_as_far_as_it_goes(path: Path, crossfix: Crossfix) -> None:
    record_torn(path)
    shown = crossfix("verify", path, "--refuse")
    assert shown.code == 1, shown
    assert f"{OUTPUTS - 1} outputs, all equal" in shown.out
    assert "not whole" in shown.out
    assert "unfinished" in shown.out
    assert "1 outputs at the torn end were not compared" in shown.out


def test_cut_off_anywhere_it_is_not_whole(path: Path, crossfix: Crossfix) -> None:
    record(path)
    data, chance = path.read_bytes(), random.Random(SEED)
    for size in (*chance.sample(range(len(data)), 12), len(data) - 100, len(data) - 1):
        path.write_bytes(data[:size])
        assert crossfix("verify", path, "--json").code != 0, size


def test_a_recording_without_outputs_has_nothing_to_compare(path: Path, crossfix: Crossfix) -> None:
    record(path, lambda e: [] if keys.parse(e.key).topic.role is keys.Role.OUTPUT else [e])
    assert crossfix("verify", path).code == 0
    shown = crossfix("verify", path, "--refuse")
    assert shown.code == 2
    assert "no outputs to compare" in shown.err


def test_a_damaged_recording_cannot_be_read(path: Path, crossfix: Crossfix) -> None:
    record(path)
    data = bytearray(path.read_bytes())
    data[data.index(b"zstd") + 200] ^= 1  # within the first chunk of messages
    path.write_bytes(data)
    shown = crossfix("verify", path)
    assert shown.code == 2
    assert shown.err.startswith("error: ")
    assert len(shown.err.splitlines()) == 1


def test_a_file_that_is_no_recording(path: Path, crossfix: Crossfix) -> None:
    path.write_text("not MCAP")
    assert crossfix("verify", path).code == 2


@pytest.mark.parametrize(
    ("recorded", "fused", "difference"),
    [
        ({"a": 1}, {"a": 2}, ("a", 1, 2)),
        ({"a": {"b": [1, {"c": 2}]}}, {"a": {"b": [1, {"c": 3}]}}, ("a.b[1].c", 2, 3)),
        ({"a": [1]}, {"a": [1, 2]}, ("a[1]", None, 2)),
        ({"a": 1, "b": 0.0}, {"a": 1, "b": -0.0}, ("b", 0.0, -0.0)),
        ({"a": 1}, {"b": 2}, ("a", 1, None)),
        ({"a": 1, "b": 2}, {"b": 2, "a": 1}, ("(encoding)", {"a": 1, "b": 2}, {"b": 2, "a": 1})),
    ],
)
def test_first_difference(recorded: object, fused: object, difference: tuple) -> None:
    assert first_difference(recorded, fused) == difference


def test_a_tolerance_takes_small_differences_for_none(path: Path, crossfix: Crossfix) -> None:
    def alter(entry: Entry) -> Iterable[Entry]:
        if (entry.key, entry.step) == (CORRECTION, 4):
            axes = entry.message.own_axes
            axes = replace(axes, north_m=axes.north_m * (1 + 1e-12))
            return [entry._replace(message=replace(entry.message, own_axes=axes))]
        return [entry]

    record(path, alter)
    assert crossfix("verify", path, "--refuse").code == 1
    shown = crossfix("verify", path, "--refuse", "--tolerance", "1e-9")
    assert shown.code == 0
    assert "1 of them within the tolerance" in shown.out
    assert crossfix("verify", path, "--refuse", "--tolerance", "1e-15").code == 1
    assert crossfix("verify", path, "--refuse", "--tolerance", "-1").code == 2


def test_outputs_that_are_none_are_an_error(path: Path, crossfix: Crossfix) -> None:
    record(path)
    bad = path.with_name("bad.mcap")

    def spoil(message):
        return [message._replace(payload=b"\xc1")] if message.key == CORRECTION else [message]

    remade(path, bad, spoil)
    shown = crossfix("verify", bad, "--refuse")
    assert shown.code == 2
    assert "not an output" in shown.err


@pytest.mark.parametrize(
    "form", [{"enable_crcs": False}, {"use_chunking": False}], ids=["no_crc", "unchunked"]
)
def test_messages_without_a_checksum_are_told(
    form: dict[str, bool], path: Path, tmp_path: Path, crossfix: Crossfix
) -> None:
    record(path)
    assert "no checksum" not in crossfix("verify", path).out
    other = tmp_path / "other.mcap"
    with open_recording(path) as recording, other.open("wb") as file:
        writer = Writer(file, **form)  # type: ignore[arg-type]
        writer.start(profile="crossfix")
        for metadata in recording.index.metadata:
            writer.add_metadata(metadata.name, metadata.metadata)
        for message in recording.messages():
            channel = writer.register_channel(message.key, "msgpack", 0)
            writer.add_message(channel, message.log_time_ns, message.payload, 0, message.sequence)
        writer.finish()
    assert "no checksum" in crossfix("verify", other).out
