"""Recordings of every kind a report has to show: whole, blind, torn, empty, crowded, hostile."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec
from msgspec.structs import replace

from schemas import codec, keys
from schemas import messages as m
from schemas.bus.memory_bus import MemoryNetwork
from schemas.recording.contents import RunEnd, RunHeader, run_attachments
from schemas.recording.reader import Recorded, open_recording
from schemas.recording.writer import RecordingWriter
from sim_world.scenario import parse_scenario
from tests.whole.in_memory import MemoryRun

SMALL = Path(__file__).parents[1] / "whole" / "small.toml"
HOSTILE = "</script><script>window.hurt=1</script><img src=x onerror='window.hurt=1'>"
CROWD, CROWDED_STEPS = 1000, 60
SMALL_RESERVE = 64 * 1024


class Sent(NamedTuple):
    """A message and its key."""

    topic: keys.Topic
    ids: tuple[str, ...]
    message: msgspec.Struct


def whole(folder: Path) -> Path:
    """A run of two carriers of which one is killed and comes back."""
    path = folder / "whole.mcap"
    scenario = parse_scenario(SMALL.read_text(encoding="utf-8"), SMALL.name)

    def kill_and_restart(run: MemoryRun) -> None:
        run.await_step(12)
        run.kill_carrier("bravo")
        run.await_step(16)
        run.start_carrier("bravo")

    MemoryRun(scenario, MemoryNetwork(), path).carry_out(kill_and_restart)
    return path


def without(source: Path, target: Path, *unwanted: keys.Topic) -> Path:
    """The same recording without some topics."""

    def unless_unwanted(recorded: Recorded) -> Iterator[Recorded]:
        if recorded.address.topic not in unwanted:
            yield recorded

    return altered(source, target, unless_unwanted)


def altered(source: Path, target: Path, instead: Callable[[Recorded], Iterable[Recorded]]) -> Path:
    """The same recording with other messages instead of each."""
    with open_recording(source) as recording:
        files = [a for a in recording.attachments.values() if a.name != "schemas.json"]
        with RecordingWriter(
            target, recording.header, attachments=files, reserve_bytes=SMALL_RESERVE
        ) as writer:
            for message in (new for old in recording.messages() for new in instead(old)):
                writer.write(
                    message.key,
                    message.payload,
                    message.encoding,
                    log_time_ns=message.log_time_ns,
                    publish_time_ns=message.publish_time_ns,
                    sequence=message.sequence,
                )
            writer.close(recording.end or RunEnd(reason="cut"))
    return target


def with_stranger(source: Path, target: Path) -> Path:
    """The same recording with corrections of a carrier of which the truth knows nothing."""

    def also(recorded: Recorded) -> Iterator[Recorded]:
        yield recorded
        if recorded.address.topic is keys.CORRECTION:
            correction = replace(recorded.decode(), carrier="stranger")
            key = keys.CORRECTION.key(recorded.address.run, "fusion", "stranger")
            yield recorded._replace(key=key, payload=codec.encode(correction))

    return altered(source, target, also)


def torn(source: Path, target: Path) -> Path:
    """The first part of the bytes, as a killed recorder leaves them: the last chunk is torn."""
    target.write_bytes(source.read_bytes()[: _within_a_late_chunk(source)])
    return target


def damaged(source: Path, target: Path) -> Path:
    """The same bytes but for one, in a late chunk."""
    data = bytearray(source.read_bytes())
    data[_within_a_late_chunk(source)] ^= 0xFF
    target.write_bytes(data)
    return target


def _within_a_late_chunk(path: Path) -> int:
    """An offset after which a part of the messages follows, and before which most lie."""
    with open_recording(path) as recording:
        spans = recording.index.spans
    late = spans[2 * len(spans) // 3]
    return (late.offset + late.end) // 2


def made(path: Path, scenario: m.DeclaredScenario, sent: Iterable[Sent]) -> Path:
    """A recording of given messages."""
    header = RunHeader(run="made", scenario=scenario.name)
    attachments = run_attachments(scenario)
    with RecordingWriter(
        path, header, attachments=attachments, reserve_bytes=SMALL_RESERVE
    ) as writer:
        for topic, ids, message in sent:
            t_ns = getattr(message, "t_ns", 0)
            writer.write(
                topic.key("made", *ids),
                codec.encode(message),
                codec.encoding_of(type(message)),
                log_time_ns=t_ns,
                publish_time_ns=t_ns,
                sequence=getattr(message, "seq", 0),
            )
        writer.close(RunEnd(reason="finished"))
    return path


def declared(title: str = "Made", steps: int = CROWDED_STEPS) -> m.DeclaredScenario:
    """Two carriers and nothing else."""
    scenario = parse_scenario(SMALL.read_text(encoding="utf-8"), SMALL.name).declared
    return replace(scenario, title=title, steps=steps)


def bare(folder: Path) -> Path:
    """A run that was recorded before anybody said anything."""
    return made(folder / "bare.mcap", declared(), ())


def crowded(folder: Path) -> Path:
    """A thousand true targets, all of them seen by both carriers at every step."""
    return made(folder / "crowded.mcap", declared(), _crowd())


def hostile(folder: Path) -> Path:
    """Names that would be code if anybody took them for it."""
    scenario = declared(HOSTILE, steps=3)
    return made(folder / "hostile.mcap", scenario, _hostile(scenario))


def _crowd() -> Iterator[Sent]:
    scenario = declared()
    for step in range(1, CROWDED_STEPS + 1):
        t_ns = scenario.epoch_ns + step * scenario.step_ns
        yield Sent(keys.TRUTH_CARRIERS, (), _true_carriers(step, t_ns))
        yield Sent(keys.TRUTH_TARGETS, (), _true_crowd(step, t_ns))
        for carrier in ("alpha", "bravo"):
            yield from _said(scenario, carrier, step, t_ns, [str(n) for n in range(CROWD)])
        yield Sent(keys.CLOSED_FUSION, (), m.Closed(step=step, t_ns=t_ns))


def _hostile(scenario: m.DeclaredScenario) -> Iterator[Sent]:
    for step in range(1, 4):
        t_ns = scenario.epoch_ns + step * scenario.step_ns
        yield from _said(scenario, "alpha", step, t_ns, [HOSTILE])
        yield Sent(keys.CLOSED_FUSION, (), m.Closed(step=step, t_ns=t_ns))
    news = m.Health(
        centre="fusion", t_ns=scenario.epoch_ns, step=3, news=[HOSTILE],
        streams=[m.StreamStatistics(carrier="alpha", stream="radar", rejected=1, reason=HOSTILE)],
    )  # fmt: skip
    yield Sent(keys.HEALTH, ("fusion",), news)


def _said(
    scenario: m.DeclaredScenario, carrier: str, step: int, t_ns: int, names: list[str]
) -> Iterator[Sent]:
    """Navigation and a report of one carrier; targets stand on a ring around it."""
    origin = scenario.origin
    longitude = origin.longitude_rad + (0.002 if carrier == "bravo" else 0.0)
    pose = m.Pose(latitude_rad=origin.latitude_rad, longitude_rad=longitude)
    stamp = {"carrier": carrier, "boot": "b1", "seq": step, "step": step, "t_ns": t_ns}
    yield Sent(keys.NAVIGATION, (carrier,), m.Navigation(**stamp, stream="navigation", pose=pose))
    report = m.SourceReport(
        **stamp,
        stream="radar",
        bearing_rad=[(0.001 * n + 0.5) % 6.0 for n in range(len(names))],
        range_m=[4000.0 + 7 * n for n in range(len(names))],
        identity=names,
    )
    yield Sent(keys.REPORT, (carrier, "radar"), report)


def _true_carriers(step: int, t_ns: int) -> m.TruthCarriers:
    still = [[0.0, 0.0, 0.0]] * 2
    return m.TruthCarriers(
        boot="w", seq=step, step=step, t_ns=t_ns, carrier=["alpha", "bravo"],
        position_m=[[0.0, 0.0, 0.0], [9000.0, 0.0, 0.0]], velocity_mps=still,
        acceleration_mps2=still, heading_rad=[0.0, 0.0], north_error_rad=[0.0, 0.0],
    )  # fmt: skip


def _true_crowd(step: int, t_ns: int) -> m.TruthTargets:
    still = [[0.0, 0.0, 0.0]] * CROWD
    return m.TruthTargets(
        boot="w", seq=step, step=step, t_ns=t_ns, number=list(range(CROWD)),
        position_m=[[10.0 * n - 5000, 5.0 * step + n % 97 * 40, 0.0] for n in range(CROWD)],
        velocity_mps=still, acceleration_mps2=still,
    )  # fmt: skip
