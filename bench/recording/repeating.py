"""A recording fused again, against its own time; a change of 1e-15 in it that is to be found."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.figures import Figure, at_least, cpu_scale, told
from bench.in_process import Played, played
from crossfix.making import attachments_of, put, writing
from crossfix.refusing import Refused, refuse
from schemas import codec, keys
from schemas.messages import Input, Navigation, Ranging, SourceInfo, SourceReport
from schemas.recording.contents import RunEnd, RunHeader, run_attachments
from schemas.recording.reader import Recorded, open_recording
from schemas.recording.writer import RecordingWriter
from sim_world.scenario import Scenario, load_scenario
from tests.crossfix.remade import with_field

STRAIT = Path(__file__).parents[2] / "scenarios" / "strait.toml"
RUN = "strait"
LEAST_STEPS = 60
TINY = 1e-15
CHANGES = 10


def figures(folder: Path, seed: int, size: float) -> Iterator[Figure]:
    """The default scenario, as much of it as the size of the run asks for."""
    scenario = load_scenario(STRAIT)
    steps = max(LEAST_STEPS, round(min(size, 1.0) * scenario.declared.steps))
    path = folder / "strait.mcap"
    record(path, scenario, steps)
    before_s = time.process_time()
    with open_recording(path) as recording:
        refused: Refused = refuse(recording, folder / "again.mcap", {})
    took_s = (time.process_time() - before_s) * cpu_scale()
    yield at_least("refuse, default scenario: times real time", refused.span_s / took_s, 20)
    yield told("refuse, default scenario: steps", refused.steps)
    found = sum(is_found(path, folder / f"tiny{n}.mcap", seed + n) for n in range(CHANGES))
    yield at_least("diff: changes of 1e-15 named", found, CHANGES, f"of {CHANGES}")


def record(path: Path, scenario: Scenario, steps: int) -> None:
    """What a run says and fuses, without the processes."""
    declared = scenario.declared
    header = RunHeader(run=RUN, scenario=declared.name, created_ns=declared.epoch_ns)
    with RecordingWriter(path, header, attachments=run_attachments(declared)) as writer:
        for step in played(scenario, steps=steps):
            for key, message in spoken(step):
                writer.write(
                    key,
                    codec.encode(message),
                    codec.encoding_of(type(message)),
                    log_time_ns=step.closed.t_ns,
                    publish_time_ns=step.closed.t_ns,
                    sequence=getattr(message, "seq", step.closed.step),
                )
        writer.close(RunEnd(reason="finished"))


def spoken(step: Played) -> Iterator[tuple[str, Input]]:
    """Messages of a step with their keys, in the order in which they came."""
    for message in step.said:
        yield key_of(message), message
    yield keys.CLOSED_FUSION.key(RUN), step.closed  # type: ignore[misc]
    for topic, ids, output in step.outputs:
        yield topic.key(RUN, *ids), output  # type: ignore[misc]


def key_of(message: Input) -> str:
    """Where a carrier publishes it."""
    topic = _TOPICS[type(message)]
    sources = (message.stream,) if topic is keys.REPORT else ()
    if isinstance(message, SourceInfo):
        sources = (message.source,)
    return topic.key(RUN, message.carrier, *sources)


def is_found(path: Path, other: Path, seed: int) -> bool:
    """Whether `diff` names the one message, and the field, that differ by 1e-15."""
    with open_recording(path) as recording:
        reports = [m for m in recording.messages(topics=(keys.REPORT,)) if _bearings(m)]
        meant = reports[np.random.default_rng(seed).integers(len(reports))]
        with writing(other, recording.header, attachments_of(recording)) as writer:
            for message in recording.messages():
                is_it = (message.key, message.sequence) == (meant.key, meant.sequence)
                put(writer, _nudged(message) if is_it else message)
            writer.close(RunEnd(reason="finished"))
    command = [sys.executable, "-m", "crossfix", "diff", str(path), str(other), "--json"]
    done = subprocess.run(command, capture_output=True, check=False)  # noqa: S603 - ours
    first = json.loads(done.stdout)["first"]
    named = (first["sequence"], first["field"]) == (meant.sequence, "bearing_rad[0]")
    return done.returncode == 1 and named


def _bearings(message: Recorded) -> list[float]:
    """Those small enough that 1e-15 changes the first of them."""
    bearings = getattr(message.decode(), "bearing_rad", None) or []
    return bearings if bearings and bearings[0] + TINY != bearings[0] else []


def _nudged(message: Recorded) -> Recorded:
    return with_field(message, "bearing_rad", value=lambda old: [old[0] + TINY, *old[1:]])


_TOPICS = {
    SourceReport: keys.REPORT,
    Navigation: keys.NAVIGATION,
    Ranging: keys.RANGING,
    SourceInfo: keys.SOURCE,
}
