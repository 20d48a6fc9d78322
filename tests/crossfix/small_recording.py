"""A small recording with a true fusion in it, and ways to spoil it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import cache
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import msgspec

from schemas import codec, keys
from schemas.recording.contents import run_attachments
from schemas.recording.writer import RecordingWriter, RunEnd, RunHeader
from tests.fusion_center.scenes import closed, stamp, two_ships

RUN = "small"
STEPS = 6
CORRECTION = keys.CORRECTION.key(RUN, keys.FUSION, "b")
REPORT = keys.REPORT.key(RUN, "b", "radar")


class Entry(NamedTuple):
    """One message as it goes into the recording."""

    key: str
    message: msgspec.Struct
    step: int


Spoil = Callable[[Entry], Iterable[Entry]]


def record(path: Path, spoil: Spoil = lambda entry: [entry]) -> list[Entry]:
    """Write a recording of two ships, each entry as `spoil` leaves it; what was written."""
    entries = list(chain.from_iterable(map(spoil, _entries())))
    writer = RecordingWriter(
        path,
        RunHeader(run=RUN, scenario="scene", created_ns=stamp(0)),
        attachments=run_attachments(two_ships().scenario()),
    )
    for entry in entries:
        _write(writer, entry)
    writer.close(RunEnd(reason="finished", received=len(entries), recorded=len(entries)))
    return entries


def record_torn(path: Path) -> None:
    """The same as a killed recorder leaves it: without an end, in the midst of the last step."""
    whole = path.with_suffix(".whole")
    entries = _entries()
    writer = RecordingWriter(
        whole,
        RunHeader(run=RUN, scenario="scene", created_ns=stamp(0)),
        attachments=run_attachments(two_ships().scenario()),
    )
    for entry in entries[:-1]:  # the last output had not come yet
        _write(writer, entry)
    writer.flush()
    path.write_bytes(whole.read_bytes())
    writer.close(RunEnd(reason="finished"))


@cache
def _entries() -> tuple[Entry, ...]:
    return tuple(_fused())


def _fused() -> Iterator[Entry]:
    scene = two_ships()
    _, fused = scene.run(STEPS)
    for step, outputs in enumerate(fused, start=1):
        said = scene.said(step)
        for message in said:
            yield Entry(_key(message), message, step)
        yield Entry(keys.CLOSED_FUSION.key(RUN), closed(step, said), step)
        for topic, ids, output in outputs:
            yield Entry(topic.key(RUN, *ids), output, step)


def _key(message: msgspec.Struct) -> str:
    topics = {topic.message: topic for topic in (keys.SOURCE, keys.REPORT, keys.NAVIGATION)}
    topic = topics[type(message)]
    return topic.key(RUN, message.carrier, *(["radar"] if "{source}" in topic.template else []))


def _write(writer: RecordingWriter, entry: Entry) -> None:
    writer.write(
        entry.key,
        codec.encode(entry.message),
        codec.encoding_of(type(entry.message)),
        log_time_ns=stamp(entry.step),
        publish_time_ns=entry.message.t_ns,
        sequence=getattr(entry.message, "seq", entry.step),
    )
