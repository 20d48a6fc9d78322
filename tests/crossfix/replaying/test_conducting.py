"""The world's part in a replay: what is lost on its way is said again, one that sticks is left."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from crossfix.replaying import conducting
from crossfix.replaying.conducting import World, world_boot
from schemas import codec, keys
from schemas.bus.interface import Inbox, Sample
from schemas.bus.member import Buses, Member
from schemas.bus.memory_bus import MemoryNetwork
from schemas.errors import BusError
from schemas.messages import Closed, Step
from schemas.recording.reader import open_recording
from tests.crossfix.small_recording import STEPS, record

RUN = "again"
QUIET_S = 0.05


class Centre:
    """A fusion centre that misses what a world closes for the first time, step after step."""

    def __init__(self, network: MemoryNetwork, most: int) -> None:
        buses = Buses(network.bus("fusion"), network.bus("fusion"))
        self.member = Member(RUN, keys.FUSION, buses)
        self.heard: Inbox[Sample] = Inbox()
        buses.control.subscribe(keys.CLOSED_WORLD.key(RUN), self.heard)
        buses.control.subscribe(keys.STEP.key(RUN), self.heard)
        self.most, self.times, self.ended = most, 0, False
        self.token = keys.alive(RUN, keys.FUSION, self.member.boot)
        self.thread = threading.Thread(target=self._work, daemon=True)
        self.thread.start()

    def _work(self) -> None:
        control = self.member.buses.control
        recorder = keys.alive(RUN, keys.RECORDER, "r")
        with control.announce(self.token), control.announce(recorder):
            while not self.ended:
                for sample in self.heard.take(QUIET_S):
                    self._hear(sample)
                self.member.ack(min(self.most, STEPS if self.times > 1 else 0))

    def _hear(self, sample: Sample) -> None:
        topic = keys.parse(sample.key).topic
        message = codec.decode(topic.message, sample.payload, sample.encoding)
        self.times += isinstance(message, Closed) and message.step == STEPS
        self.ended |= isinstance(message, Step) and bool(message.ended)


@contextmanager
def playing(path: Path, most: int) -> Iterator[tuple[Centre, World]]:
    """A replay that has said all of a small recording, before a centre that goes so far."""
    record(path)
    with MemoryNetwork() as network, open_recording(path) as recording:
        centre = Centre(network, most)
        buses = Buses(network.bus("world"), network.bus("world"))
        with Member(RUN, keys.WORLD, buses) as member:
            member.boot = world_boot(recording) or member.boot
            world = World(member, recording, lambda message: None)
            try:
                with world.present(5.0):
                    for message in recording.messages():
                        world(message)
                    yield centre, world
            finally:
                centre.ended = True
                centre.thread.join()


def test_what_was_closed_last_is_said_until_it_is_heard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conducting, "REPEAT_S", 0.1)
    monkeypatch.setattr(conducting, "PATIENCE_S", 10.0)
    with playing(tmp_path / "small.mcap", STEPS) as (centre, _):
        pass
    assert centre.times > 1


def test_a_centre_that_says_the_same_for_ever_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conducting, "PATIENCE_S", 0.5)
    started_s = time.monotonic()
    with (
        pytest.raises(BusError, match="nothing beyond step 0"),
        playing(tmp_path / "small.mcap", 0),
    ):
        pass
    assert time.monotonic() - started_s < 10.0
