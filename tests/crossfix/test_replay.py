"""`replay`: the same bytes on the same keys in the same order, at the pace asked for."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from schemas import codec, keys
from schemas.bus.interface import Bus, Inbox, Sample
from schemas.bus.zenoh_bus import open_bus
from schemas.recording.reader import open_recording, output_bytes
from tests.crossfix.conftest import Crossfix, started
from tests.crossfix.small_recording import Entry, record

DEADLINE_S = 20.0


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "small.mcap"


@pytest.fixture
def bus(hub: str) -> Iterator[Bus]:
    with open_bus(hub) as opened:
        yield opened


def listen(bus: Bus, run: str) -> Inbox[Sample]:
    inbox: Inbox[Sample] = Inbox()
    bus.subscribe(keys.everything(run), inbox)
    return inbox


def arrived(inbox: Inbox[Sample], count: int) -> list[Sample]:
    samples: list[Sample] = []
    deadline_s = time.monotonic() + DEADLINE_S
    while len(samples) < count and time.monotonic() < deadline_s:
        samples += inbox.take(0.05)
    return samples


def expected(entries: list[Entry], run: str, *roles: keys.Role) -> list[Sample]:
    return [
        Sample(
            entry.key.replace("/small/", f"/{run}/"),
            codec.encode(entry.message),
            codec.encoding_of(type(entry.message)),
        )
        for entry in entries
        if keys.parse(entry.key).topic.role in roles
    ]


@pytest.mark.live
@pytest.mark.timeout(60)
def test_inputs_come_again_byte_for_byte_and_in_order(
    path: Path, hub: str, bus: Bus, crossfix: Crossfix
) -> None:
    entries, inbox = record(path), listen(bus, "small")
    shown = crossfix("replay", path, "--rate", "max", "--connect", hub)
    assert shown.code == 0, shown
    inputs = expected(entries, "small", keys.Role.INPUT)
    assert f"{len(inputs)} messages of run small" in shown.err
    got = arrived(inbox, len(inputs))
    for key in {sample.key for sample in inputs}:  # order holds within a key: QoS differ
        assert [s for s in got if s.key == key] == [s for s in inputs if s.key == key]


@pytest.mark.live
@pytest.mark.timeout(60)
def test_other_roles_under_another_name(path: Path, hub: str, bus: Bus, crossfix: Crossfix) -> None:
    entries, inbox = record(path), listen(bus, "other")
    shown = crossfix("replay", path, "--connect", hub, "--rate=max", "--role=output", "--run=other")
    assert shown.code == 0, shown
    outputs = expected(entries, "other", keys.Role.OUTPUT)
    assert sorted(arrived(inbox, len(outputs))) == sorted(outputs)


@pytest.mark.live
@pytest.mark.timeout(60)
def test_it_does_not_speak_for_a_process_that_is_alive(
    path: Path, hub: str, bus: Bus, crossfix: Crossfix
) -> None:
    record(path)
    with bus.announce(keys.alive("taken", "b", "b7")):
        shown = crossfix("replay", path, "--connect", hub, "--run", "taken")
    assert shown.code == 2
    assert "alive in run taken: b" in shown.err


@pytest.mark.parametrize("rate", ["0", "-1", "nan"])
def test_a_rate_that_is_none_is_refused(path: Path, rate: str, crossfix: Crossfix) -> None:
    shown = crossfix("replay", path, f"--rate={rate}")
    assert shown.code == 2
    assert "--rate" in shown.err


@pytest.mark.live
@pytest.mark.timeout(120)
def test_two_replays_into_a_fusion_centre_give_the_recorded_bytes(
    path: Path, tmp_path: Path, hub: str
) -> None:
    entries = record(path)
    outputs = [e for e in entries if keys.parse(e.key).topic.role is keys.Role.OUTPUT]
    for rate in ("max", "20"):
        again = tmp_path / f"{rate}.mcap"
        at = ("--run", f"again{rate}", "--connect", hub)
        with started("fusion", *at, "--output", str(again)) as fusion:
            with started("replay", str(path), *at, "--as-world", "--rate", rate) as replay:
                assert replay.wait(DEADLINE_S) == 0, replay.communicate()[1]
            assert fusion.wait(DEADLINE_S) == 0
        with open_recording(again) as recording:
            found = sorted(payload for _, payload in output_bytes(recording))
        assert found == sorted(codec.encode(entry.message) for entry in outputs)
