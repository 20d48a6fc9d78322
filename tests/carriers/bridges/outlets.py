"""A bridge whose messages are kept instead of sent, and a clock that stands where it is put."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

import msgspec

from carriers.bridges.bridge import Bridge, Station
from carriers.bridges.feeds import Arrival
from carriers.bridges.jsonl import JsonLines
from schemas import codec, keys
from schemas.messages import Pose

T = TypeVar("T", bound=msgspec.Struct)
SECOND = 10**9
NOW_NS = 1_767_225_600 * SECOND
POSE = Pose(latitude_rad=0.63, longitude_rad=-0.1)


class Kept:
    """An outlet that keeps what it is given, as it would be on the wire."""

    boot = "b1"

    def __init__(self) -> None:
        self.sent: list[tuple[str, msgspec.Struct]] = []

    def send(self, topic: keys.Topic, ids: Iterable[str], message: msgspec.Struct) -> None:
        again = codec.decode(type(message), codec.encode(message))
        self.sent.append((topic.key("r", *ids), again))

    def of(self, kind: type[T]) -> list[T]:
        return [message for _, message in self.sent if isinstance(message, kind)]


class Bench:
    """A bridge for lines of JSON, as carrier `harbour` with the source `radar`."""

    def __init__(self, station: Station | None = None) -> None:
        self.kept = Kept()
        self.now_ns = NOW_NS
        station = Station(pose=POSE) if station is None else station
        self.bridge = Bridge("harbour", self.kept, station, lambda: self.now_ns)
        self._decode = JsonLines("harbour", "radar")

    def feed(self, data: bytes) -> list[str]:
        """Take datagrams of lines; what is wrong with them, by field."""
        errors = [self.bridge.take(found) for found in self._decode(Arrival(0, data, whole=True))]
        return [error.field for error in errors if error is not None]
