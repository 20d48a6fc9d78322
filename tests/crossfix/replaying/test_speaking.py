"""A replay speaks for those who were recorded: their bytes, their answers, their names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from msgspec.structs import replace as changed

from crossfix.replaying import speaking
from crossfix.replaying.remapping import Renames, renames_of
from crossfix.replaying.speaking import Speaker, refuse_if_alive
from schemas import codec, keys
from schemas.bus.interface import Bus, Inbox, Sample
from schemas.bus.memory_bus import MemoryNetwork
from schemas.errors import BusError, CrossfixError
from schemas.messages import BackfillReply, BackfillRequest, Closed, SourceInfo, SourceReport
from schemas.received import receive
from schemas.recording.reader import Recorded, Recording, open_recording
from tests.crossfix.small_recording import RUN, STEPS, record


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[Recording]:
    record(tmp_path / "small.mcap")
    with open_recording(tmp_path / "small.mcap") as opened:
        yield opened


@pytest.fixture
def network() -> Iterator[MemoryNetwork]:
    with MemoryNetwork() as network:
        yield network


def inputs(recording: Recording) -> list[Recorded]:
    return list(recording.messages(roles=(keys.Role.INPUT,)))


def heard(network: MemoryNetwork, recording: Recording, run: str, renames: Renames) -> list[Sample]:
    inbox: Inbox[Sample] = Inbox()
    network.bus("listener").subscribe(keys.everything(run), inbox)
    speaker = Speaker(network.bus("replay"), run, renames)
    for message in inputs(recording):
        speaker(message)
    return inbox.take()


def ask(bus: Bus, run: str, process: str, request: BackfillRequest) -> list[Sample]:
    key = keys.BACKFILL.key(run, process)
    [answer] = bus.query(key, codec.encode(request), codec.encoding_of(BackfillRequest), 5.0)
    records = codec.decode(BackfillReply, answer.payload).records
    return [Sample(record.key, record.payload, record.encoding) for record in records]


def test_bytes_and_keys_are_those_recorded(network: MemoryNetwork, recording: Recording) -> None:
    found = heard(network, recording, RUN, Renames())
    assert found == [Sample(m.key, m.payload, m.encoding) for m in inputs(recording)]


def test_another_run_changes_the_key_alone(network: MemoryNetwork, recording: Recording) -> None:
    found = heard(network, recording, "other", Renames())
    assert [s.payload for s in found] == [m.payload for m in inputs(recording)]
    assert {keys.parse(s.key).run for s in found} == {"other"}


def test_what_was_missed_is_answered_for(network: MemoryNetwork, recording: Recording) -> None:
    samples = heard(network, recording, RUN, Renames())
    key = keys.REPORT.key(RUN, "b", "radar")
    reports = [s for s in samples if s.key == key]
    boot = codec.decode(SourceReport, reports[0].payload).boot
    bus = network.bus("listener")
    request = BackfillRequest(boot=boot, stream="radar", first=2, last=3)
    assert ask(bus, RUN, "b", request) == reports[1:3]
    other = BackfillRequest(boot="never", stream="radar", first=2, last=3)
    assert ask(bus, RUN, "b", other) == []
    closings = BackfillRequest(stream="closed/fusion", first=1, last=STEPS)
    found = ask(bus, RUN, "fusion", closings)
    assert [codec.decode(Closed, s.payload).step for s in found] == list(range(1, STEPS + 1))


def test_the_oldest_is_forgotten_first(
    network: MemoryNetwork, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(speaking, "KEEP_BYTES", 4000)
    samples = heard(network, recording, RUN, Renames())
    bus = network.bus("listener")
    closings = BackfillRequest(stream="closed/fusion", first=1, last=STEPS)
    found = ask(bus, RUN, "fusion", closings)
    steps = [codec.decode(Closed, s.payload).step for s in found]
    assert steps == list(range(STEPS - len(steps) + 1, STEPS + 1))
    assert 0 < len(steps) < STEPS
    assert samples


def test_latched_values_are_answered(network: MemoryNetwork, recording: Recording) -> None:
    samples = heard(network, recording, RUN, Renames())
    key = keys.SOURCE.key(RUN, "b", "radar")
    assert network.bus("late").query(key, b"", "", 5.0) == [s for s in samples if s.key == key][-1:]


def test_other_names_stand_in_key_and_envelope(
    network: MemoryNetwork, recording: Recording
) -> None:
    renames = renames_of(["b=bravo", "a/radar=a/mast"])
    samples = heard(network, recording, RUN, renames)
    received = [receive(sample) for sample in samples]  # refuses where they disagree
    carriers = {m.carrier for _, m in received if isinstance(m, SourceReport | SourceInfo)}
    assert carriers == {"a", "bravo"}
    reports = [m for _, m in received if isinstance(m, SourceReport)]
    assert {(m.carrier, m.stream) for m in reports} == {("a", "mast"), ("bravo", "radar")}
    before = [m.decode() for m in inputs(recording) if m.address.topic is keys.REPORT]
    assert [m.bearing_rad for m in reports] == [m.bearing_rad for m in before]  # type: ignore[attr-defined]


def test_a_correction_goes_by_the_new_name_of_its_carrier(recording: Recording) -> None:
    """Else the fusion centre would not know it for its own."""
    one = next(m for m in inputs(recording) if m.address.topic is keys.REPORT)
    said = one.decode()
    assert isinstance(said, SourceReport)
    spoken = changed(said, correction_id=f"fusion/{said.carrier}/3")
    renames = renames_of(["a=alpha", "b=bravo"])
    ids, rename = renames.ids(one.address)
    assert rename is not None
    payload = renames.rewritten(one._replace(payload=codec.encode(spoken)), rename)
    assert codec.decode(SourceReport, payload).correction_id == f"fusion/{ids['carrier']}/3"


@pytest.mark.parametrize("rule", ["", "a", "a=", "=b", "a=B!", "a/radar=b/radar", "a=b/c", "a/b=c"])
def test_a_rule_that_is_none_is_refused(rule: str) -> None:
    with pytest.raises(CrossfixError):
        renames_of([rule])


def test_it_does_not_speak_for_who_is_alive(network: MemoryNetwork, recording: Recording) -> None:
    bus = network.bus("somebody")
    refuse_if_alive(recording, RUN, bus)
    with bus.announce(keys.alive(RUN, "b", "b1")):
        with pytest.raises(BusError, match="alive in run small: b"):
            refuse_if_alive(recording, RUN, bus)
        refuse_if_alive(recording, "other", bus)
