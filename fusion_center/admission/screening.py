"""What may go into a recording: every recorded message is whole, of this run, and of bounded kind.

Whatever is recorded decodes again, and a message that is refused never takes the place of the one
that is meant: a stream's next seq belongs to the first *valid* message that bears it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from msgspec import Struct

from schemas import keys
from schemas.bus.interface import Sample
from schemas.bus.ledger import StreamKey
from schemas.bus.roster import Life
from schemas.errors import WireError
from schemas.messages import (
    Closed,
    DeclaredScenario,
    Input,
    Step,
    TruthCarriers,
    TruthTargets,
)
from schemas.received import receive
from schemas.recording.writer import MAX_ENCODING_CHARS
from schemas.shapes import Lane, Shapes

from .lives import Door, Lives
from .steps import instant_ns, refusal

MAX_CHANNELS = {"member": 2048, "stranger": 512, "status": 512, "run": 1000}
"""By whose they are; together no more than a recording takes."""


class Screened(NamedTuple):
    """A message that may be recorded, and its place in its stream (seq 0: it has none)."""

    address: keys.Address
    message: Struct
    stream: StreamKey
    seq: int
    t_ns: int


class Source(NamedTuple):
    """Whom a message is counted for."""

    carrier: str
    stream: str


class Screen:
    """Looks at every sample before it is recorded.

    Args:
        scenario: of the run; without one it is not asked whether a message can be of it.
        forget: is told of streams that had to make room.
    """

    def __init__(
        self,
        scenario: DeclaredScenario | None,
        lives: Lives,
        forget: Callable[[StreamKey], None],
    ) -> None:
        self._scenario, self._lives = scenario, lives
        self._door = Door(lives, forget)
        self._shapes = Shapes()
        self._open: set[tuple[str, str]] = set()
        self._channels = dict.fromkeys(MAX_CHANNELS, 0)

    def admit(self, address: keys.Address, sample: Sample) -> Screened:
        """The message of a sample.

        Raises:
            WireError: why it may not be recorded.
        """
        message = receive(sample).message
        if address.ids.get("centre", keys.FUSION) != keys.FUSION:
            raise WireError("of another fusion centre", got=address.ids["centre"])
        stream = stream_key(address, message)
        is_input = isinstance(message, Input)
        reason = self._door.admit(stream) if is_input else self._is_of_another_run(message)
        if reason:
            raise WireError(reason, where=sample.key)
        self._require_channel(address, stream, sample)
        seq = getattr(message, "seq", 0) or getattr(message, "step", 0)
        is_status = address.topic.role is keys.Role.STATUS
        return Screened(
            address, message, stream, 0 if is_status else seq, getattr(message, "t_ns", 0)
        )

    def lane(self, screened: Screened, encoding: str) -> Lane | None:
        """Where the further messages of a stream are read; None if of nobody who takes part."""
        message, stream = screened.message, screened.stream
        if isinstance(message, Input) and Life(stream.process, stream.boot) in self._lives:
            return Lane(self._shapes, stream, type(message), encoding)
        return None

    def _is_of_another_run(self, message: Struct) -> str:
        """Why a message of world or fusion centre cannot be theirs; empty if it can."""
        if self._scenario is None:
            return ""
        if isinstance(message, DeclaredScenario):
            return "" if message == self._scenario else "another scenario"
        of_world = isinstance(message, Step | TruthTargets | TruthCarriers)
        if of_world and not self._lives.is_world(getattr(message, "boot", "")):
            return "of no world of this run"
        if isinstance(message, Step):
            return refusal(message, self._scenario)
        if isinstance(message, Closed | TruthTargets | TruthCarriers):
            right = message.t_ns == instant_ns(self._scenario, message.step)
            return "" if right and message.step <= self._scenario.steps else "no step of this run"
        return ""

    def _require_channel(self, address: keys.Address, stream: StreamKey, sample: Sample) -> None:
        """A recording has so many channels; those of strangers must leave room for the others'."""
        channel = (sample.key, sample.encoding)
        if channel in self._open:
            return
        kind = "run"
        if address.topic.role is keys.Role.STATUS:
            kind = "status"
        elif stream.boot:
            kind = "member" if Life(stream.process, stream.boot) in self._lives else "stranger"
        if len(sample.encoding) > MAX_ENCODING_CHARS or not sample.encoding.isascii():
            raise WireError("no encoding", got=sample.encoding[:MAX_ENCODING_CHARS])
        if self._channels[kind] >= MAX_CHANNELS[kind]:
            raise WireError(f"more than {MAX_CHANNELS[kind]} keys and encodings of one kind")
        self._channels[kind] += 1
        self._open.add(channel)


def stream_key(address: keys.Address, message: Struct) -> StreamKey:
    """Streams of carriers count per boot; world and fusion centre have one boot a run."""
    if isinstance(message, Input):
        return StreamKey(message.carrier, message.boot, message.stream)
    return StreamKey(_owner(address.topic), "", keys.stream(address))


def source_of(address: keys.Address) -> Source:
    """Whom a message at this address is counted for."""
    if "carrier" in address.ids and address.topic.role is keys.Role.INPUT:
        return Source(address.ids["carrier"], keys.stream(address))
    owner = address.ids.get("process") or address.ids.get("centre")
    return Source(owner or _owner(address.topic), address.topic.name)


def _owner(topic: keys.Topic) -> str:
    """World or fusion centre, of what bears the name of no process."""
    of_world = topic.role is keys.Role.TRUTH or topic in _OF_WORLD
    return keys.WORLD if of_world else keys.FUSION


_OF_WORLD = (keys.SCENARIO, keys.STEP, keys.CLOSED_WORLD)
