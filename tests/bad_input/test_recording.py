"""What may go into a recording: a broken message never takes the place of the one that is meant."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

import msgpack
import pytest

from fusion_center.admission.lives import MAX_LIVES, MAX_PROCESSES, Lives
from fusion_center.admission.screening import MAX_CHANNELS
from schemas import codec, keys
from schemas.bus.interface import Sample
from schemas.bus.memory_bus import MemoryNetwork
from schemas.bus.roster import Life
from schemas.messages import Closed, Quality, SourceReport, Step
from schemas.recording.reader import open_recording
from schemas.recording.writer import MAX_CHANNELS as CHANNELS_OF_A_RECORDING
from tests.bad_input.test_flood import RUN, SCENARIO, started

EPOCH_NS, SECOND = SCENARIO.epoch_ns, SCENARIO.step_ns


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    logging.disable(logging.WARNING)
    yield
    logging.disable(logging.NOTSET)


def report(seq: int, carrier: str = "alpha", **fields: object) -> Sample:
    message = {
        "carrier": carrier, "boot": "a", "stream": "radar", "seq": seq,
        "t_ns": EPOCH_NS + seq * SECOND, **fields,
    }  # fmt: skip
    encoding = codec.encoding_of(SourceReport)
    return Sample(keys.REPORT.key(RUN, carrier, "radar"), msgpack.packb(message), encoding)


def recorded(path: Path, *samples: Sample) -> tuple[list[tuple[str, bytes]], dict[str, int]]:
    """What a recorder keeps of samples, and its counters."""
    with MemoryNetwork() as network:
        recorder = started(network, path)
        recorder.lives.show({Life("world", "w")}, [Life("world", "w"), Life("alpha", "a")])
        bus = network.bus("anybody")
        for sample in samples:
            bus.publish(*sample, keys.REPORT.qos)
        recorder.finish("over", {})
        counters = recorder.counters()
    with open_recording(path) as recording:
        return [(m.key, m.payload) for m in recording.messages()], counters


def of(topic: keys.Topic, ids: tuple[str, ...], message: object) -> Sample:
    kind = type(message)
    return Sample(topic.key(RUN, *ids), codec.encode(message), codec.encoding_of(kind))  # type: ignore[arg-type]


def test_a_broken_message_does_not_take_the_place_of_the_true_one(tmp_path: Path) -> None:
    """A bearing of NaN with the next seq of its stream used to keep the right one out."""
    broken = report(1, bearing_rad=[float("nan")])
    mislabelled = report(2)._replace(key=report(2, "bravo").key)
    true = [report(1, bearing_rad=[1.0]), report(2)]
    kept, counters = recorded(tmp_path / "r.mcap", broken, mislabelled, *true, true[0])
    assert kept == [(sample.key, sample.payload) for sample in true]
    assert (counters["rejected"], counters["repeated"]) == (2, 1)


def test_forged_steps_closings_and_another_centres_outputs_stay_out(tmp_path: Path) -> None:
    right = of(keys.STEP, (), Step(boot="w", step=1, t_ns=EPOCH_NS + SECOND))
    forged = [
        of(keys.STEP, (), Step(boot="forged", step=1, t_ns=EPOCH_NS + SECOND)),
        of(keys.STEP, (), Step(boot="w", step=2, t_ns=2**62)),
        of(keys.STEP, (), Step(boot="w", step=2**62, t_ns=EPOCH_NS)),
        of(keys.CLOSED_FUSION, (), Closed(step=2**62, t_ns=EPOCH_NS)),
        of(keys.CLOSED_WORLD, (), Closed(step=1, t_ns=5)),
        of(keys.QUALITY, ("mallory",), Quality(centre="mallory", seq=1, step=1, t_ns=1)),
        of(keys.QUALITY, ("fusion",), Quality(centre="mallory", seq=1, step=1, t_ns=1)),
        of(keys.SCENARIO, (), SCENARIO.__class__(**{**fields_of(SCENARIO), "steps": 7})),
    ]
    kept, counters = recorded(tmp_path / "r.mcap", *forged, right)
    assert kept == [(right.key, right.payload)]
    assert counters["rejected"] == len(forged)
    with open_recording(tmp_path / "r.mcap") as recording:
        (step,) = recording.messages()
        assert step.log_time_ns == EPOCH_NS + SECOND


def fields_of(scenario: object) -> dict[str, object]:
    return {name: getattr(scenario, name) for name in scenario.__struct_fields__}  # type: ignore[attr-defined]


def test_strangers_and_their_encodings_leave_channels_to_the_others(tmp_path: Path) -> None:
    strangers = [report(1, f"c{n}") for n in range(MAX_CHANNELS["stranger"] + 100)]
    odd = [report(n + 1)._replace(encoding=f"application/x{n}") for n in range(20)]
    worse = [report(30)._replace(encoding="ä"), report(30)._replace(encoding="x" * 300)]
    kept, counters = recorded(tmp_path / "r.mcap", *strangers, *odd, *worse, report(30))
    assert len(kept) == MAX_CHANNELS["stranger"] + 20 + 1
    assert counters["rejected"] == 102
    assert kept[-1] == (report(30).key, report(30).payload)
    assert sum(MAX_CHANNELS.values()) < CHANNELS_OF_A_RECORDING


def test_there_is_always_room_for_the_declared() -> None:
    lives = Lives(["late"])
    crowd = {Life(f"c{n}", "b") for n in range(MAX_LIVES + 10)}
    assert len(lives.show(crowd, crowd)) == 10
    assert lives.show(crowd, [Life("late", "l")]) == []
    for n in range(MAX_PROCESSES):
        lives.show(set(), [Life(f"d{n}", "b")])
    assert lives.show(set(), [Life("one-more", "b")]) == [Life("one-more", "b")]
    assert lives.show(set(), [Life("late", "again")]) == []
    assert Life("late", "again") in lives
