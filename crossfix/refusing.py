"""Fuses the inputs of a recording again, with other settings, into a recording of its own."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from msgspec.structs import replace

from crossfix.making import Made, end_of, header_of, is_torn, made, put, writing
from crossfix.reading_progress import Show, unseen
from crossfix.settings_changes import SettingChange, changes_between, with_changes
from fusion_center.fuse import Fusible, fuse
from fusion_center.pipeline import initial
from fusion_center.published import Outputs
from fusion_center.settings import settings_from
from schemas import codec, keys
from schemas.errors import RecordingError, WireError
from schemas.messages import Closed, DeclaredScenario, Event, Input
from schemas.recording.contents import (
    Attachment,
    RunHeader,
    hash_of,
    run_attachments,
    truth_of,
)
from schemas.recording.fingerprint import installed_versions, numeric_fingerprint
from schemas.recording.reader import Recorded, Recording
from schemas.recording.writer import RecordingWriter

AHEAD = 500
"""A gap that the recorder has filled stands in the file up to so many Closed messages late."""


class Refused(NamedTuple):
    """What came of fusing a recording again.

    Attributes:
        steps: fused; span_s: of scenario time in them.
        replaced: outputs of the old recording that were left out.
        unfused: Closed messages at the torn end that name what is not in the recording; they
            are left out as well.
        settings: what was changed.
    """

    made: Made
    steps: int
    span_s: float
    outputs: int
    replaced: int
    unfused: int
    settings: Sequence[SettingChange]


def refuse(
    recording: Recording,
    path: Path,
    overrides: Mapping[str, Any],
    show: Show = unseen,
) -> Refused:
    """Write a recording with the same inputs, truth, status and control, and outputs fused anew.

    The scenario attached to it declares the settings it was fused with, so that it repeats its own
    outputs (`verify --refuse`) as the first one does. Nothing but the inputs decides the outputs:
    no network, no clock.

    Args:
        overrides: setting by its dotted name, such as `association.gate`, -> its new value.

    Raises:
        SettingsError: no such setting, or a value outside its limits.
        RecordingError: damaged, without a scenario, or an input that was fused is not in it.
        LaunchError: `path` exists or cannot be made.
    """
    scenario = with_changes(recording.scenario, overrides)
    centre = centre_of(recording)
    initial(scenario, settings_from(scenario.fusion), centre)  # refuse before anything is written
    changes = changes_between(recording.scenario, scenario)
    config = msgspec.json.encode(scenario.fusion)
    files = _attachments(recording, scenario, config)
    with writing(path, _header(recording, changes, config), files) as writer:
        fusing = _Fusing(recording, scenario, writer, show)
        fusing.run(centre)
        writer.close(end_of(recording, "fused again", fusing.written))
    return Refused(
        made(path, fusing.written),
        fusing.steps,
        fusing.steps * scenario.step_ns * 1e-9,
        fusing.outputs,
        fusing.replaced,
        fusing.unfused,
        changes,
    )


def centre_of(recording: Recording) -> str:
    """The fusion centre whose outputs a recording holds; the usual one where there are none.

    Raises:
        RecordingError: it holds those of several.
    """
    centres = set[str]()
    for channel in recording.index.channels.values():
        with suppress(WireError):
            address = keys.parse(channel.topic)
            if address.topic.role is keys.Role.OUTPUT:
                centres.add(address.ids["centre"])
    if len(centres) > 1:
        got = ", ".join(sorted(centres))
        raise RecordingError(
            "outputs of several fusion centres",
            got=got,
            expected="crossfix cut --keys, one of them",
        )
    return centres.pop() if centres else keys.FUSION


class _Waiting(NamedTuple):
    """A message that is kept, and its place among all that were read."""

    place: int
    message: Recorded


class _Fusing:
    """Passes a recording through: what is kept waits for the outputs of the steps before it."""

    def __init__(
        self,
        recording: Recording,
        scenario: DeclaredScenario,
        writer: RecordingWriter,
        show: Show,
    ) -> None:
        self.written = self.steps = self.outputs = self.replaced = self.unfused = 0
        self._recording, self._scenario = recording, scenario
        self._writer, self._show = writer, show
        self._waiting: deque[_Waiting] = deque()
        self._closed: dict[int, _Waiting] = {}

    def run(self, centre: str) -> None:
        """Fuse and write everything."""
        try:
            for outputs in fuse(self._fusibles(), centre=centre, ahead=AHEAD):
                self._write_step(outputs)
        except RecordingError:
            if not is_torn(self._recording) or self._recording.index.damage is not None:
                raise
        if not self.steps:
            raise RecordingError(
                "nothing to fuse",
                where=self._recording.header.run,
                got="no closed/fusion whose inputs are there",
                expected="a recording of a fusion centre",
            )
        self._write_rest()

    def _fusibles(self) -> Iterator[Fusible]:
        yield self._scenario
        for place, message in enumerate(self._recording.messages(), start=1):
            self._show(place, message.log_time_ns)
            if message.address.topic.role is keys.Role.OUTPUT:
                self.replaced += 1
                continue
            self._waiting.append(_Waiting(place, message))
            if message.address.topic.role is keys.Role.INPUT:
                yield from self._fusible(self._waiting[-1])

    def _fusible(self, waiting: _Waiting) -> Iterator[Fusible]:
        """The message, if it can be read: what the bus has refused was never fused either."""
        with suppress(WireError):
            decoded = waiting.message.decode()
            if isinstance(decoded, Closed):
                self._closed.setdefault(decoded.step, waiting)
            if isinstance(decoded, Closed | Event | Input):
                yield decoded

    def _write_step(self, outputs: Outputs) -> None:
        """Everything up to the Closed of a step, then what it has led to."""
        closed = self._closed.pop(outputs[0].message.step)
        while self._waiting and self._waiting[0].place <= closed.place:
            self._put(self._waiting.popleft().message)
        run = self._recording.header.run
        for topic, ids, message in outputs:
            self._writer.write(
                topic.key(run, *ids),
                codec.encode(message),
                codec.encoding_of(topic.message),
                log_time_ns=closed.message.log_time_ns,
                publish_time_ns=message.t_ns,
                sequence=message.seq,
            )
        self.steps += 1
        self.outputs += len(outputs)
        self.written += len(outputs)

    def _write_rest(self) -> None:
        """What came after the last step that could be fused, without the Closed of later ones."""
        unfused = {closed.place for closed in self._closed.values()}
        self.unfused = len(unfused)
        for place, message in self._waiting:
            if place not in unfused:
                self._put(message)

    def _put(self, message: Recorded) -> None:
        put(self._writer, message)
        self.written += 1


def _header(recording: Recording, changes: Sequence[SettingChange], config: bytes) -> RunHeader:
    told = {f"set.{change.name}": f"{change.before} -> {change.after}" for change in changes}
    return replace(
        header_of(recording, {"verb": "refuse", "outputs": "fused again"} | told),
        config_hash=hash_of(config),
        versions=installed_versions(),
        fingerprint=numeric_fingerprint(),
    )


def _attachments(
    recording: Recording, scenario: DeclaredScenario, config: bytes
) -> list[Attachment]:
    """The declared scenario and configuration with the new settings; the truth as it was."""
    return run_attachments(scenario, truth_of(recording.attachments), config)
