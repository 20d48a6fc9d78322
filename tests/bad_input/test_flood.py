"""A flood of random and mutated payloads through ingest and recorder: no crash, all counted."""

from __future__ import annotations

import logging
import tracemalloc
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from fusion_center.admission.lives import Lives
from fusion_center.process.ingest import Ingest
from fusion_center.recorder import Recorder
from schemas import codec, keys
from schemas.bus.interface import Sample
from schemas.bus.member import Buses, Member
from schemas.bus.memory_bus import MemoryNetwork
from schemas.conformance import Conformance
from schemas.errors import WireError
from schemas.messages import DeclaredCarrier, DeclaredScenario, Health, Origin
from schemas.recording.contents import RunHeader, run_attachments
from schemas.recording.reader import open_recording
from schemas.recording.writer import RecordingWriter
from tests.bad_input.payloads import Chaos

RUN = "flood"
SCENARIO = DeclaredScenario(
    name=RUN,
    origin=Origin(latitude_rad=0.6, longitude_rad=0.1),
    epoch_ns=1_767_225_600 * 10**9,
    step_ns=10**9,
    steps=60,
    carriers=[DeclaredCarrier(name="alpha", sigma_position_m=1.0, sigma_north_rad=0.01)],
)
SIZES = [pytest.param(5_000), pytest.param(100_000, marks=pytest.mark.slow)]
MEMORY_BYTES = 64 * 1024 * 1024


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    logging.disable(logging.WARNING)
    yield
    logging.disable(logging.NOTSET)


@pytest.mark.parametrize("count", SIZES)
def test_ingest_counts_every_payload_and_stays_small(count: int) -> None:
    ingest = Ingest(Lives())
    tracemalloc.start()
    for sample in Chaos(1, RUN).samples(count):
        ingest.accept(sample)
    held_bytes, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    rows = ingest.statistics()
    assert sum(row.received + row.duplicates + row.rejected for row in rows) == count
    assert all(row.reason for row in rows if row.rejected)
    assert sum(row.received for row in rows) > count / 200  # some are as good as any
    assert held_bytes < MEMORY_BYTES
    assert ingest.gaps() == []
    assert ingest.ends(2**62, only_stepless=False) == []
    health = Health(centre="fusion", t_ns=0, step=0, streams=rows)
    assert len(codec.encode(health)) < 512 * 1024


@pytest.mark.parametrize("count", SIZES)
def test_the_recorder_counts_every_payload_and_keeps_only_what_decodes(
    tmp_path: Path, count: int
) -> None:
    path = tmp_path / "flood.mcap"
    with MemoryNetwork() as network:
        recorder = started(network, path)
        sent = publish(network, Chaos(2, RUN).samples(count))
        recorder.finish("flooded", {})
        counted = recorder.counters()
    assert counted["received"] == sent
    assert counted["dropped"] == 0
    parts = ("recorded", "rejected", "repeated", "passed_over")
    assert sum(counted[part] for part in parts) == sent
    assert counted["recorded"] > 0
    assert readable(path) == counted["recorded"]
    with open_recording(path) as recording:
        assert recording.end is not None
        assert recording.end.rejected == counted["rejected"]
        assert 1 < len(recording.end.rejections) <= 100


@pytest.mark.parametrize("count", SIZES)
def test_conformance_listens_to_a_flood_without_a_crash(count: int) -> None:
    conformance = Conformance(RUN)
    for sample in Chaos(3, RUN).samples(count):
        conformance.take(sample, 1_767_225_700.0)
    findings = conformance.findings()
    assert {"schema", "payload", "envelope", "key", "two_processes"} <= {f.code for f in findings}
    conformance.sigma_checks()


def started(network: MemoryNetwork, path: Path) -> Recorder:
    buses = Buses(network.bus(keys.RECORDER), network.bus(keys.RECORDER))
    header = RunHeader(run=RUN, scenario=RUN)
    writer = RecordingWriter(path, header, attachments=run_attachments(SCENARIO))
    recorder = Recorder(Member(RUN, keys.RECORDER, buses), writer, SCENARIO)
    recorder.start()
    return recorder


def publish(network: MemoryNetwork, samples: Iterable[Sample]) -> int:
    """Put samples on the bus; how many it took, and the recorder hears of."""
    bus, sent = network.bus("mallory"), 0
    for sample in samples:
        try:
            bus.publish(*sample, keys.REPORT.qos)
        except WireError:  # no key of any bus
            continue
        sent += sample.key.startswith(f"{keys.PREFIX}/{RUN}")
    return sent


def readable(path: Path) -> int:
    """How many messages of the wire decode."""
    with open_recording(path) as recording:
        return sum(message.decode() is not None for message in recording.messages())
