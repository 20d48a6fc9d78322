"""Files of other MCAP writers: other compression, chunks, orders, and things not of the wire."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType, Writer

from schemas.errors import RecordingError
from schemas.recording.contents import END, RUN, to_metadata
from schemas.recording.reader import open_recording, summary
from schemas.recording.recovery import recover
from tests.schemas.recording.recordings import DONE, HEADER, Written, everything, messages, read

SEED = 20260101
STREAM = list(messages(300))
FORMS: dict[str, dict[str, Any]] = {
    "lz4": {"compression": CompressionType.LZ4, "chunk_size": 2000},
    "plain": {"compression": CompressionType.NONE, "chunk_size": 5000},
    "one chunk": {"chunk_size": 10**9},
    "without chunks": {"use_chunking": False},
    "without index": {"index_types": IndexType.NONE, "chunk_size": 3000},
    "without checksums": {"enable_crcs": False, "chunk_size": 3000},
    "without statistics": {"use_statistics": False, "chunk_size": 3000},
    "without repeated channels": {"repeat_channels": False, "repeat_schemas": False},
    "without offsets": {"use_summary_offsets": False},
}
every_form = pytest.mark.parametrize("form", FORMS.values(), ids=FORMS.keys())


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def write_plainly(
    path: Path, stream: list[Written], *, finish: bool = True, header: bool = True, **form: Any
) -> None:
    with path.open("wb") as file:
        writer = Writer(file, **form)
        writer.start()
        if header:
            writer.add_metadata(RUN, to_metadata(HEADER))
        channels: dict[str, int] = {}
        other = writer.register_channel("/rosout", "cdr", 0)
        for sample in stream:
            if sample.key not in channels:
                schema = writer.register_schema("any", "jsonschema", b"{}")
                channels[sample.key] = writer.register_channel(
                    sample.key, "msgpack", schema, {"encoding": sample.encoding}
                )
            writer.add_message(other, sample.log_time_ns, b"\0", 0)
            writer.add_message(
                channels[sample.key],
                sample.log_time_ns,
                sample.payload,
                sample.publish_time_ns,
                sample.sequence,
            )
        writer.add_metadata(END, to_metadata(DONE))
        writer.flush()  # type: ignore[no-untyped-call]
        if finish:
            writer.finish()  # type: ignore[no-untyped-call]


@every_form
@pytest.mark.parametrize("finish", [True, False], ids=["finished", "unfinished"])
def test_files_of_a_plain_writer_read_the_same(path: Path, form: Any, finish: bool) -> None:
    write_plainly(path, STREAM, finish=finish, **form)
    with open_recording(path) as recording:
        assert everything(recording) == STREAM
        assert recording.end == DONE
        ordered = recording.messages(order="log_time")
        assert [Written(*message[1:]) for message in ordered] == STREAM
        recording.check()
    found = summary(path)
    assert found.messages == 2 * len(STREAM)
    assert next(c for c in found.channels if c.key == "/rosout")[1:] == ("", "", "cdr", len(STREAM))


@every_form
def test_messages_out_of_order_are_read_in_the_order_of_time(path: Path, form: Any) -> None:
    stirred = [STREAM[n * 7 % len(STREAM)] for n in range(len(STREAM))]
    write_plainly(path, stirred, **form)
    with open_recording(path) as recording:
        assert everything(recording) == stirred
        ordered = recording.messages(order="log_time")
        assert [Written(*message[1:]) for message in ordered] == STREAM
        part = recording.messages(
            order="log_time", start_ns=STREAM[50].log_time_ns, stop_ns=STREAM[60].log_time_ns
        )
        assert [Written(*message[1:]) for message in part] == STREAM[50:60]


@given(st.lists(st.integers(0, 6), max_size=60), st.integers(100, 900))
@settings(deadline=None, max_examples=30)
def test_ties_keep_the_order_of_the_file(
    tmp_path_factory: pytest.TempPathFactory, times_ns: list[int], chunk_size: int
) -> None:
    path = tmp_path_factory.mktemp("ties") / "run.mcap"
    stream = [
        w._replace(log_time_ns=t, sequence=n)
        for n, (w, t) in enumerate(zip(STREAM, times_ns, strict=False))
    ]
    write_plainly(path, stream, chunk_size=chunk_size)
    with open_recording(path) as recording:
        ordered = [Written(*message[1:]) for message in recording.messages(order="log_time")]
    assert ordered == sorted(stream, key=lambda w: w.log_time_ns)


def test_a_file_without_our_header_is_none_of_ours(path: Path) -> None:
    write_plainly(path, STREAM, header=False)
    with pytest.raises(RecordingError, match=r"not a recording of crossfix; got 'no metadata"):
        open_recording(path)


def test_a_message_on_a_channel_that_was_never_named_is_refused(path: Path) -> None:
    """The library writes such a file without a word."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_metadata(RUN, to_metadata(HEADER))
        writer.add_message(7, 1, b"x", 1)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(RecordingError, match="unknown channel 7"):
        read(path)


def test_messages_beside_the_chunks_of_an_indexed_file_are_missed_aloud(path: Path) -> None:
    """No index leads to them, but the counts tell."""
    write_plainly(path, STREAM[:50], chunk_size=10**9)
    with open_recording(path) as recording:
        index = recording.index
        recording.index = index._replace(spans=[], counts=index.counts)
        with pytest.raises(RecordingError, match="index and messages disagree"):
            list(recording.messages())


def read_as_far_as_it_goes(path: Path) -> tuple[list[Written], RecordingError | None]:
    found: list[Written] = []
    try:
        with open_recording(path) as recording:
            found.extend(Written(*message[1:]) for message in recording.messages())
    except RecordingError as error:
        return found, error
    return found, None


@every_form
def test_cut_anywhere_they_give_a_prefix(path: Path, form: Any) -> None:
    write_plainly(path, STREAM, **form)
    whole = path.read_bytes()
    for length in sorted(random.Random(5).sample(range(len(whole)), 60)):
        path.write_bytes(whole[:length])
        found, error = read_as_far_as_it_goes(path)
        assert found == STREAM[: len(found)]
        if error is None:
            assert summary(path).condition != ""


@every_form
def test_an_altered_bit_is_an_error_or_changes_nothing_that_has_a_checksum(
    path: Path, form: Any
) -> None:
    """Where a writer gave no checksum, nobody can tell; where it did, no wrong number comes out."""
    write_plainly(path, STREAM, **form)
    whole, rng = path.read_bytes(), random.Random(6)
    has_checksums = form.get("enable_crcs", True) and form.get("use_chunking", True)
    for _ in range(60):
        altered = bytearray(whole)
        altered[rng.randrange(8, len(whole))] ^= 1 << rng.randrange(8)
        path.write_bytes(altered)
        found, error = read_as_far_as_it_goes(path)
        if has_checksums:
            assert found == STREAM[: len(found)]
            assert error is not None or len(found) == len(STREAM)


@every_form
@pytest.mark.parametrize("finish", [True, False], ids=["finished", "unfinished"])
def test_recovered_into_a_new_file_nothing_is_lost(
    path: Path, tmp_path: Path, form: Any, finish: bool
) -> None:
    write_plainly(path, STREAM, finish=finish, **form)
    done = recover(path, tmp_path / "new.mcap")
    assert (done.damage, done.messages) == ((), 2 * len(STREAM))
    with open_recording(tmp_path / "new.mcap") as recording:
        assert (recording.condition, recording.end) == ("", DONE)
        assert everything(recording) == STREAM
        recording.check()
        assert recording.unchecked == 0 or form.get("enable_crcs") is False


def test_messages_outside_of_chunks_torn_anywhere_are_a_prefix(path: Path, tmp_path: Path) -> None:
    write_plainly(path, STREAM[:100], use_chunking=False)
    data, chance = path.read_bytes(), random.Random(SEED)
    for number, size in enumerate(chance.sample(range(len(data)), 40)):
        path.write_bytes(data[:size])
        new = tmp_path / f"{number}.mcap"
        try:
            there = read_as_far_as_it_goes(path)[0]
            done = recover(path, new)
        except RecordingError:
            assert size < 1000, size
            continue
        with open_recording(new) as recording:
            assert recording.condition == ""
            assert everything(recording) == there == STREAM[: len(there)]
        assert not done.damage


def test_messages_outside_of_chunks_are_not_moved_in_place(path: Path) -> None:
    write_plainly(path, STREAM, use_chunking=False)
    data = path.read_bytes()
    assert recover(path).was_whole
    path.write_bytes(data[:20_000])
    with pytest.raises(RecordingError, match=r"messages outside of chunks.*--output NEW"):
        recover(path)
    assert path.read_bytes() == data[:20_000]


def test_a_message_of_no_channel_is_lost_aloud(path: Path, tmp_path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start()
        writer.add_metadata(RUN, to_metadata(HEADER))
        writer.add_message(7, 1, b"x", 1)
        writer.finish()  # type: ignore[no-untyped-call]
    done = recover(path, tmp_path / "new.mcap")
    assert done.messages == 0
    assert "1 messages of no channel" in done.damage[0]


def test_a_damaged_channel_costs_its_own_messages_alone(path: Path, tmp_path: Path) -> None:
    write_plainly(path, STREAM, use_chunking=False)
    lost = STREAM[0].key
    data = bytearray(path.read_bytes())
    at = data.index(lost.encode()) - 4  # the length of its name
    data[at : at + 4] = b"\xff" * 4
    path.write_bytes(data)
    done = recover(path, tmp_path / "new.mcap")
    assert "Channel record" in done.damage[0]
    with open_recording(tmp_path / "new.mcap") as recording:
        assert everything(recording) == [w for w in STREAM if w.key != lost]
        recording.check()


@pytest.mark.parametrize("behind", [bytes(3000), random.Random(SEED).randbytes(3000)])
def test_of_a_torn_chunk_without_compression_nothing_wrong_is_salvaged(
    path: Path, tmp_path: Path, behind: bytes
) -> None:
    """Zeros stand behind a tear when the power has failed."""
    write_plainly(path, STREAM[:100], compression=CompressionType.NONE, chunk_size=10**9)
    data, chance = path.read_bytes(), random.Random(SEED)
    salvaged = 0
    for number, size in enumerate(chance.sample(range(len(data) // 4, len(data) // 2), 30)):
        path.write_bytes(data[:size] + behind)
        done = recover(path, tmp_path / f"{number}.mcap")
        with open_recording(tmp_path / f"{number}.mcap") as recording:
            found = everything(recording)
        assert found == STREAM[: len(found)]
        salvaged += done.salvaged
    assert salvaged > 0
