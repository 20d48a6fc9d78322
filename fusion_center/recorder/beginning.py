"""The beginning of a recording: what is known of the run goes into its first bytes."""

from __future__ import annotations

import time
from pathlib import Path
from typing import NamedTuple

import msgspec

from schemas import codec, keys
from schemas.bus.latched import fetch
from schemas.bus.member import Member
from schemas.messages import DeclaredScenario, TruthScenario
from schemas.recording.contents import RunHeader, hash_of, run_attachments
from schemas.recording.fingerprint import installed_versions, numeric_fingerprint
from schemas.recording.parts import ONE_FILE, Limits, PartedWriter, Safety
from schemas.recording.writer import RecordingWriter

from .commands import serve
from .rows import EVERYTHING, Wanted
from .sink import Sink
from .thread import Recorder


class How(NamedTuple):
    """How a run is recorded.

    Attributes:
        limits: when the file is full; safety: what a crash may cost; wanted: which keys.
    """

    limits: Limits = ONE_FILE
    safety: Safety = Safety()
    wanted: Wanted = EVERYTHING


def record_run(
    member: Member,
    path: Path,
    max_loss_s: float,
    timeout_s: float,
    how: How = How(),  # noqa: B008 - a constant
) -> tuple[Recorder, DeclaredScenario]:
    """Begin the recording of a run, as soon as its world is there; the declared scenario with it.

    The truth goes into the file and no further: the fusion centre is handed the declared part.

    Raises:
        BusError: no world came in time.
        RecordingError: the file exists or cannot be written.
    """
    bus, run = member.buses.data, member.run
    latched = fetch(bus, keys.SCENARIO, run, timeout_s=timeout_s)
    hidden = fetch(bus, keys.TRUTH_SCENARIO, run, timeout_s=timeout_s)
    scenario = codec.decode(DeclaredScenario, latched.payload, latched.encoding)
    truth = codec.decode(TruthScenario, hidden.payload, hidden.encoding)
    safety = how.safety._replace(max_loss_s=max_loss_s)
    recorder = begin(member, path, how._replace(safety=safety), scenario, truth)
    recorder.start(latched, hidden)
    member.announce()
    return recorder, scenario


def begin(
    member: Member,
    path: Path,
    how: How,
    scenario: DeclaredScenario | None,
    truth: TruthScenario | None,
) -> Recorder:
    """A recorder with its file; `start` sets it to work.

    Raises:
        RecordingError: the file exists or cannot be written.
    """
    config = msgspec.json.encode(scenario.fusion) if scenario else b""
    header = RunHeader(
        run=member.run,
        scenario=scenario.name if scenario else "",
        config_hash=hash_of(config) if scenario else "",
        created_ns=time.time_ns(),
        versions=installed_versions(),
        fingerprint=numeric_fingerprint(),
    )
    attachments = run_attachments(scenario, truth, config) if scenario else []
    writer: Sink
    if how.limits == ONE_FILE:
        writer = RecordingWriter(path, header, attachments=attachments, **how.safety._asdict())
    else:
        writer = PartedWriter(
            path, header, attachments=attachments, limits=how.limits, safety=how.safety
        )
    recorder = Recorder(member, writer, scenario, how.wanted)
    recorder.commands = serve(recorder, path, member)
    return recorder
