"""What is written is read: bytes, order, stamps, header, end, attachments."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import mcap.reader
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas import codec, json_schema, keys
from schemas import messages as m
from schemas.errors import RecordingError, WireError
from schemas.keys import Role
from schemas.recording.contents import (
    Attachment,
    RunEnd,
    RunHeader,
    from_metadata,
    hash_of,
    run_attachments,
    to_metadata,
)
from schemas.recording.fingerprint import (
    Fingerprint,
    installed_versions,
    numeric_fingerprint,
)
from schemas.recording.reader import digests, open_recording, output_bytes, summary
from schemas.recording.writer import MAX_CHANNELS, RecordingWriter
from tests.schemas.recording.recordings import (
    DONE,
    EPOCH_NS,
    HEADER,
    SMALL_RESERVE,
    Written,
    everything,
    messages,
    put,
    read,
    scenario,
    write,
    written,
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def writing(path: Path) -> RecordingWriter:
    return RecordingWriter(path, HEADER, reserve_bytes=SMALL_RESERVE)


def test_everything_comes_back_as_it_went_in(path: Path) -> None:
    truth = m.TruthScenario(name="strait", seed=7, text="[truth]")
    files = run_attachments(scenario(), truth, b'{"gate": 9}')
    done = write(path, messages(1000), attachments=[*files, Attachment("x", "", b"\0\1")])
    with open_recording(path) as recording:
        assert everything(recording) == done
        assert recording.header == HEADER
        assert recording.end == DONE
        assert recording.condition == ""
        assert recording.scenario == scenario()
        assert recording.attachments["config.json"].data == b'{"gate": 9}'
        assert recording.attachments["x"].data == b"\0\1"
        truth_data = recording.attachments["truth.json"].data
        assert codec.decode(m.TruthScenario, truth_data, "json") == truth
        recording.check()


def test_messages_decode_in_either_form(path: Path) -> None:
    write(path, messages(20))
    with open_recording(path) as recording:
        for message in recording.messages():
            decoded = message.decode()
            assert type(decoded) is message.address.topic.message
            assert decoded.t_ns == message.log_time_ns  # type: ignore[attr-defined]


@given(st.lists(st.tuples(st.binary(max_size=300), st.integers(0, 3), st.booleans()), max_size=60))
@settings(deadline=None, max_examples=25)
def test_any_payloads_and_flushes_come_back(
    tmp_path_factory: pytest.TempPathFactory, steps: list[tuple[bytes, int, bool]]
) -> None:
    path = tmp_path_factory.mktemp("any") / "run.mcap"
    topics = [keys.STEP.key("r"), keys.NAVIGATION.key("r", "a"), keys.HEALTH.key("r", "fusion")]
    topics.append(keys.NAVIGATION.key("r", "b"))
    done = []
    with writing(path) as writer:
        for n, (payload, topic, flush) in enumerate(steps):
            put(writer, sample := Written(topics[topic], payload, "application/msgpack", n, n, n))
            done.append(sample)
            if flush:
                writer.flush()
    assert read(path) == done


def test_the_library_reads_it_too(path: Path) -> None:
    """Any MCAP tool sees channels, schemas, roles, stamps; the index finds every message."""
    done = write(path, messages(200), flush_every=50)
    with path.open("rb") as file:
        reader = mcap.reader.make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "crossfix"
        found = list(reader.iter_messages())
        file_metadata = [record.name for record in reader.iter_metadata()]
    assert file_metadata == ["crossfix.run", "crossfix.end"]
    assert [(c.topic, r.data, r.log_time, r.publish_time, r.sequence) for _, c, r in found] == [
        (w.key, w.payload, w.log_time_ns, w.publish_time_ns, w.sequence) for w in done
    ]
    for schema, channel, _ in found:
        topic = keys.parse(channel.topic).topic
        assert schema is not None
        assert schema.encoding == "jsonschema"
        assert json.loads(schema.data) == json_schema.schema_of(topic)
        assert schema.name == f"crossfix.{topic.message.__name__}"
        assert channel.metadata["role"] == topic.role.value
        assert channel.metadata["qos"] == topic.qos.name
        assert channel.metadata["latched"] == str(topic.latched).lower()
        assert channel.metadata["encoding"].endswith(schema.name)
        assert channel.message_encoding in channel.metadata["encoding"]


def test_header_and_attachments_are_in_the_file_before_the_first_message(path: Path) -> None:
    writer = RecordingWriter(path, HEADER, attachments=run_attachments(scenario()))
    with open_recording(path) as recording:
        assert recording.header == HEADER
        assert recording.scenario == scenario()
        schemas = json.loads(recording.attachments["schemas.json"].data)
        assert schemas["SourceReport"] == json_schema.schema_of(m.SourceReport)
        assert recording.end is None
        assert recording.condition == "unfinished: no end"
        assert everything(recording) == []
    writer.close(DONE)


def test_the_clock_of_the_recorder_never_goes_back(path: Path) -> None:
    step = written(keys.STEP.key("r"), m.Step(boot="b", step=1, t_ns=5), 5)
    with writing(path) as writer:
        for t_ns in (-5, 10, 7, 20, 3):
            put(writer, step._replace(log_time_ns=t_ns, publish_time_ns=99))
    assert [(w.log_time_ns, w.publish_time_ns) for w in read(path)] == [
        (t_ns, 99) for t_ns in (0, 10, 10, 20, 20)
    ]


@pytest.mark.parametrize(
    "bad",
    [
        {"key": "crossfix/@v1/r/nothing"},
        {"key": "foxglove/log"},
        {"encoding": "x" * 300},
        {"encoding": "application/\udcff"},
        {"publish_time_ns": -1},
        {"publish_time_ns": 2**64},
        {"log_time_ns": 2**64},
    ],
)
def test_what_the_library_would_choke_on_is_refused_and_spoils_nothing(
    path: Path, bad: dict[str, Any]
) -> None:
    good = written(keys.STEP.key("r"), m.Step(boot="b", step=1, t_ns=5), 5)
    with writing(path) as writer:
        put(writer, good)
        with pytest.raises(WireError):
            put(writer, good._replace(**bad))
        with pytest.raises(TypeError, match="payload"):
            put(writer, good._replace(payload=bytearray(b"x")))  # type: ignore[arg-type]
        put(writer, good)
        assert writer.counts[:3] == (2, 2, 0)
    assert read(path) == [good, good]


def test_channels_are_bounded(path: Path) -> None:
    good = written(keys.STEP.key("r"), m.Step(boot="b", step=1, t_ns=5), 5)
    with writing(path) as writer:
        for n in range(MAX_CHANNELS):
            put(writer, good._replace(encoding=f"{n}"))
        with pytest.raises(WireError, match="too many channels"):
            put(writer, good._replace(encoding="one more"))
        put(writer, good._replace(encoding="7"))
    assert len(read(path)) == MAX_CHANNELS + 1


def test_a_sequence_of_64_bits_keeps_its_lower_half(path: Path) -> None:
    good = written(keys.STEP.key("r"), m.Step(boot="b", step=1, t_ns=5), 5)
    write(path, [good._replace(sequence=2**40 + 3)])
    assert read(path)[0].sequence == 3


def test_statistics_stay_beside_the_messages(path: Path) -> None:
    first = m.Statistics(t_ns=EPOCH_NS, received=3, recorded=3)
    second = m.Statistics(t_ns=EPOCH_NS + 1, received=9, recorded=7, dropped=2, gaps=1)
    done = list(messages(10))
    with writing(path) as writer:
        writer.write_statistics(first)
        for sample in done:
            put(writer, sample)
        writer.write_statistics(second)
        assert writer.counts[:3] == (10, 10, 0)
    with open_recording(path) as recording:
        assert list(recording.statistics()) == [first, second]
        assert everything(recording) == done
        assert recording.end == RunEnd(reason="closed", received=10, recorded=10, gaps=1)


@pytest.mark.parametrize("period_ms", [1, 20, 60, 200])
def test_tick_flushes_what_would_have_waited_too_long_by_the_next_one(
    path: Path, period_ms: int
) -> None:
    sample = next(messages(1))
    with RecordingWriter(path, HEADER, max_loss_s=0.25) as writer:
        writer.tick(0.0)
        put(writer, sample)
        ticks_ms = range(period_ms, 300, period_ms)
        flushed_ms = next(ms for ms in ticks_ms if writer.tick(ms / 1000) or read(path))
        assert flushed_ms <= 250 < flushed_ms + 2 * period_ms
        assert read(path) == [sample]
        size = writer.counts.bytes
        writer.tick(101.0)  # nothing new
        assert writer.counts.bytes == size == path.stat().st_size


def test_an_exception_in_the_run_is_the_reason_of_the_end(path: Path) -> None:
    def run() -> None:
        with writing(path) as writer:
            put(writer, next(messages(1)))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run()
    with open_recording(path) as recording:
        assert recording.end is not None
        assert recording.end.reason.startswith("ZeroDivisionError")
        assert len(everything(recording)) == 1


def test_an_existing_file_is_never_written_over(path: Path) -> None:
    write(path, messages(5))
    before = path.read_bytes()
    with pytest.raises(RecordingError, match="cannot record; got 'File exists'"):
        writing(path)
    with pytest.raises(RecordingError, match="cannot record"):
        writing(path / "below")
    assert path.read_bytes() == before


def test_roles_topics_and_times_choose_messages(path: Path) -> None:
    done = write(path, messages(100), flush_every=9)
    with open_recording(path) as recording:
        reports = [message.key for message in recording.messages(topics=[keys.REPORT])]
        assert reports == [w.key for w in done if "/report/" in w.key]
        outputs = list(recording.messages(roles=[Role.OUTPUT]))
        assert {message.address.topic for message in outputs} == {keys.CORRECTION}
        assert list(output_bytes(recording)) == [(o.key, o.payload) for o in outputs]
        assert list(recording.messages(topics=[keys.REPORT], roles=[Role.OUTPUT])) == []
        part = recording.messages(start_ns=done[20].log_time_ns, stop_ns=done[40].log_time_ns)
        assert [Written(*message[1:]) for message in part] == done[20:40]


def test_digests_see_the_payloads_and_not_the_chunks(tmp_path: Path) -> None:
    def digests_of(name: str, stream: list[Written], flush_every: int) -> dict[str, str]:
        write(tmp_path / name, stream, flush_every=flush_every)
        with open_recording(tmp_path / name) as recording:
            return digests(recording)

    done = list(messages(50))
    whole = digests_of("a", done, 0)
    assert list(whole) == [keys.CORRECTION.key("strait", "fusion", "bravo")]
    assert digests_of("b", done, 3) == whole
    altered = [
        w._replace(payload=w.payload[:-1] + b"!") if n == 49 else w for n, w in enumerate(done)
    ]
    assert digests_of("c", altered, 0) != whole
    assert digests_of("d", done[:49], 0) != whole


def test_summary_says_what_is_in_it(path: Path) -> None:
    done = write(path, messages(100), attachments=run_attachments(scenario()))
    found = summary(path)
    assert (found.header, found.end, found.condition) == (HEADER, DONE, "")
    assert (found.messages, found.bytes) == (100, path.stat().st_size)
    assert (found.start_ns, found.end_ns) == (done[0].log_time_ns, done[-1].log_time_ns)
    assert found.attachments == ("scenario.json", "schemas.json")
    assert sum(channel.messages for channel in found.channels) == 100
    closed = next(c for c in found.channels if c.key.endswith("closed/fusion"))
    assert closed[1:] == ("input", "crossfix.Closed", "msgpack", 20)


@given(
    st.builds(
        RunHeader,
        run=st.text(max_size=20),
        scenario=st.text(max_size=20),
        created_ns=st.integers(0, 2**63 - 1),
        versions=st.dictionaries(st.text(min_size=1, max_size=9), st.text(max_size=9), max_size=3),
        fingerprint=st.builds(Fingerprint, numpy=st.text(max_size=9), blas=st.text(max_size=9)),
    )
)
def test_headers_are_texts_and_back(header: RunHeader) -> None:
    texts = to_metadata(header)
    assert all(isinstance(text, str) for text in texts.values())
    assert from_metadata(RunHeader, texts, "here") == header
    with pytest.raises(RecordingError, match="here: metadata damaged"):
        from_metadata(RunHeader, texts | {"run": header.run + "x"}, "here")


def test_a_newer_format_is_refused_by_name(path: Path) -> None:
    with RecordingWriter(path, RunHeader(run="strait", format=2)):
        pass
    with pytest.raises(RecordingError, match="newer crossfix; got 'format 2'; expected at most 1"):
        open_recording(path)


def test_the_fingerprint_names_what_decides_the_last_bits() -> None:
    found = numeric_fingerprint()
    assert found == numeric_fingerprint()
    assert all([found.numpy, found.blas, found.simd, found.machine])
    assert installed_versions()["numpy"] == found.numpy
    assert hash_of(b"a") != hash_of(b"b")


def test_recordings_need_neither_zenoh_nor_numpy() -> None:
    code = (
        "import sys, schemas.recording.reader, schemas.recording.writer as w;"
        "sys.exit(bool({'zenoh', 'numpy', 'scipy'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=60).returncode == 0
