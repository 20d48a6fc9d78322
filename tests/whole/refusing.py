"""Fusing a recording's inputs once more."""

from __future__ import annotations

from pathlib import Path

from fusion_center.fuse import fuse
from schemas import codec, keys
from schemas.recording.reader import open_recording


def refused(path: Path) -> list[tuple[str, bytes]]:
    """Key and payload of every output that the recorded inputs give, by key and sequence."""
    with open_recording(path) as recording:
        run = recording.header.run
        inputs = [m.decode() for m in recording.messages(roles=(keys.Role.INPUT,))]
        again = [
            (published.topic.key(run, *published.ids), codec.encode(published.message))
            for outputs in fuse([recording.scenario, *inputs], ahead=len(inputs))
            for published in outputs
        ]
    return sorted(again, key=lambda pair: pair[0])
