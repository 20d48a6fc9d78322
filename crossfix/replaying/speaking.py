"""Speaks for those who were recorded: publishes their messages and answers for them."""

from __future__ import annotations

from collections import deque
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass

import msgspec

from schemas import codec, keys
from schemas.bus.answering import reply_to
from schemas.bus.interface import Bus, Sample
from schemas.bus.outbox import MAX_RECORDS, REPLY_BYTES
from schemas.errors import BusError, WireError
from schemas.messages import BackfillRecord, BackfillReply, BackfillRequest, Input
from schemas.qos import Qos
from schemas.recording.reader import Recorded, Recording, known_channel

from .remapping import NO_RENAMES, Renames

OVERHEAD_BYTES = 256
"""Of a message that is kept, beside its payload."""
KEEP_BYTES = 32 * 1024 * 1024
"""Of what was published last is kept for those who have missed it."""


class _Boot(msgspec.Struct):
    boot: str = ""


@dataclass(slots=True, eq=False)
class _Lane:
    """Where the messages of one recorded key go; of a latched one, the last."""

    key: str
    qos: Qos
    process: str
    stream: str
    rename: Mapping[str, str] | None
    latched: bool
    last: Sample | None = None


_Kept = tuple[_Lane, int, bytes, str]
"""Lane, sequence, payload and encoding of a message that was published."""


class Speaker:
    """Publishes recorded messages in a run, on the keys they had there.

    Args:
        run: name to publish under.
        renames: carriers and sources that go by other names; their envelopes then say so too.
    """

    def __init__(self, bus: Bus, run: str, renames: Renames = NO_RENAMES) -> None:
        self._bus, self._run, self._renames = bus, run, renames
        self._lanes: dict[str, _Lane] = {}
        self._kept: deque[_Kept] = deque()
        self._bytes = 0
        self._served: set[str] = set()

    def __call__(self, message: Recorded) -> None:
        """Publish one message, and keep it for those who miss it."""
        address, key, payload, encoding, _, _, sequence = message
        lane = self._lanes.get(key) or self._open(key, address)
        if lane.rename is not None:
            payload = self._renames.rewritten(message, lane.rename)
        self._kept.append((lane, sequence, payload, encoding))
        self._bytes += len(payload) + OVERHEAD_BYTES
        while self._bytes > KEEP_BYTES:
            self._bytes -= len(self._kept.popleft()[2]) + OVERHEAD_BYTES
        self._bus.publish(lane.key, payload, encoding, lane.qos)
        if lane.latched:
            self._latch(lane, Sample(lane.key, payload, encoding))

    def prepare(self, recording: Recording, roles: Container[keys.Role]) -> None:
        """Declare what will be answered for, so that no message has to wait for that."""
        for channel in recording.index.channels.values():
            known = known_channel(channel)
            if known is not None and known.address.topic.role in roles:
                self._open(known.key, known.address)

    def _open(self, key: str, address: keys.Address) -> _Lane:
        ids, rename = self._renames.ids(address)
        lane = _Lane(
            key=address.topic.key(self._run, *ids.values()),
            qos=address.topic.qos,
            process=_owner(keys.Address(self._run, address.topic, ids)),
            stream=keys.stream(keys.Address(self._run, address.topic, ids)),
            rename=rename,
            latched=address.topic.latched,
        )
        self._lanes[key] = lane
        if lane.process not in self._served:
            self._served.add(lane.process)
            self._bus.serve(keys.BACKFILL.key(self._run, lane.process), self._backfill)
        return lane

    def _latch(self, lane: _Lane, sample: Sample) -> None:
        new, lane.last = lane.last is None, sample
        if new:
            self._bus.serve(lane.key, lambda _: [lane.last] if lane.last else [])

    def _backfill(self, question: Sample) -> Iterable[Sample]:
        request = codec.decode(BackfillRequest, question.payload, question.encoding)
        process = question.key.rpartition("/")[2]
        records: list[BackfillRecord] = []
        size = 0
        for sample in self._missed(process, request):
            size += len(sample.payload)
            if len(records) == MAX_RECORDS or (records and size > REPLY_BYTES):
                break
            records.append(
                BackfillRecord(key=sample.key, encoding=sample.encoding, payload=sample.payload)
            )
        yield reply_to(question, BackfillReply(records=records))

    def _missed(self, process: str, request: BackfillRequest) -> list[Sample]:
        found = [
            Sample(lane.key, payload, encoding)
            for lane, sequence, payload, encoding in self._kept.copy()  # it goes on meanwhile
            if lane.process == process
            and lane.stream == request.stream
            and request.first <= sequence <= request.last
        ]
        return [sample for sample in found if request.boot in ("", _boot(sample))]


def refuse_if_alive(recording: Recording, run: str, bus: Bus) -> None:
    """Do not speak for a process that speaks for itself.

    Raises:
        BusError: one of those recorded is alive in this run; names them.
    """
    alive = {keys.parse_alive(token)[1] for token in bus.tokens(keys.every_alive(run))}
    if speakers := sorted(alive & speakers_of(recording)):
        raise BusError(
            f"alive in run {run}: {', '.join(speakers)}", expected="another --run, or their end"
        )


def speakers_of(recording: Recording) -> set[str]:
    """Carriers by the channels of a recording."""
    carriers = set[str]()
    for channel in recording.index.channels.values():
        try:
            address = keys.parse(channel.topic)
        except WireError:
            continue
        if address.topic.role is keys.Role.INPUT and "carrier" in address.ids:
            carriers.add(address.ids["carrier"])
    return carriers


def _owner(address: keys.Address) -> str:
    """The process that answers for what is published there."""
    ids, topic = address.ids, address.topic
    if issubclass(topic.message, Input):
        return ids["carrier"]
    if topic.role is keys.Role.TRUTH or topic in (keys.SCENARIO, keys.STEP, keys.CLOSED_WORLD):
        return keys.WORLD
    return ids.get("centre") or ids.get("process") or keys.FUSION


def _boot(sample: Sample) -> str:
    try:
        if "json" in sample.encoding:
            return msgspec.json.decode(sample.payload, type=_Boot).boot
        return msgspec.msgpack.decode(sample.payload, type=_Boot).boot
    except msgspec.MsgspecError:
        return ""
