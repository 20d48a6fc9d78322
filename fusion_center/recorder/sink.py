"""What a recorder writes by."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Protocol

from schemas.messages import Statistics
from schemas.recording.contents import RunEnd
from schemas.recording.writer import Counts


class Sink(Protocol):
    """What a recording is written by: `RecordingWriter`, or `PartedWriter`."""

    @property
    def counts(self) -> Counts:
        """As of now."""

    @property
    def unwritten(self) -> Counter[str]:
        """Of the messages taken, those that the disk then did not take, by key."""

    def write(
        self,
        key: str,
        payload: bytes,
        encoding: str,
        log_time_ns: int,
        publish_time_ns: int,
        sequence: int,
    ) -> None:
        """Record a sample."""

    def write_statistics(self, statistics: Statistics) -> None:
        """Record the recorder's own counts."""

    def tick(self, now_s: float) -> None:
        """Flush what has waited long enough."""

    def flush(self) -> None:
        """Flush what has waited at all."""

    def split(self) -> None:
        """Go on in a new part."""

    def files(self) -> list[Path]:
        """What holds the recording so far."""

    def close(self, end: RunEnd) -> None:
        """Seal the file."""
