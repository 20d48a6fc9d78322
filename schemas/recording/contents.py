"""What a recording holds besides messages: header, end, attachments, and how they are named."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from hashlib import sha256
from typing import Any, NamedTuple, TypeVar

import msgspec

from ..codec import decode, encode_json
from ..errors import RecordingError
from ..json_schema import MESSAGES, VERSION, exported
from ..messages import DeclaredScenario, TruthScenario
from .fingerprint import Fingerprint

FORMAT = 1
"""Counts up when an older reader would misunderstand a newer recording."""
PROFILE = "crossfix"
RUN, END, STATISTICS = "crossfix.run", "crossfix.end", "crossfix.stats"
SCENARIO, TRUTH, CONFIG, SCHEMAS = "scenario.json", "truth.json", "config.json", "schemas.json"
NEXT_PART = "goes on in the next part"
_CHECKSUM = "crc32"
T = TypeVar("T", "RunHeader", "RunEnd")


class RunHeader(msgspec.Struct, frozen=True, kw_only=True):
    """What was run, by what, on what kind of machine (metadata `crossfix.run`).

    Attributes:
        scenario: name of the scenario; the whole of it is attached.
        config_hash: SHA-256 of the attached configuration.
        created_ns: wall clock, Unix nanoseconds.
        versions: of crossfix and of what it is built on.
        fingerprint: recordings of equal fingerprints re-fuse to equal bytes.
        made_from: of a recording made of others: by which verb, of what, and what was changed.
        format: of the recording; protocol: of the wire.
        part: counts from 1 where a recording is split into several files; 0 = it is one file.
        repeated: how many messages it begins with are the last values of latched keys from before,
            so that it can be read alone; the counts of its end are without them.
    """

    run: str
    scenario: str = ""
    config_hash: str = ""
    created_ns: int = 0
    versions: dict[str, str] = {}
    fingerprint: Fingerprint = Fingerprint()
    made_from: dict[str, str] = {}
    format: int = FORMAT
    protocol: str = VERSION
    part: int = 0
    repeated: int = 0


class RunEnd(msgspec.Struct, frozen=True, kw_only=True):
    """How a recording ended (metadata `crossfix.end`).

    Attributes:
        reason: finished, interrupted, or what went wrong; `NEXT_PART` if there is one more part.
        received: samples offered; recorded: messages in the file; dropped: lost by the recorder.
        gaps: messages that never arrived and could not be fetched again.
        rejected: messages refused for what they held.
        rejections: the same by source, as carrier/stream -> count and last reason.
        torn: the recorder never got to its end, which others have written; the last messages
            may lack what they name.
    """

    reason: str
    received: int = 0
    recorded: int = 0
    dropped: int = 0
    gaps: int = 0
    rejected: int = 0
    rejections: dict[str, str] = {}
    torn: bool = False


class Attachment(NamedTuple):
    """A file within the recording."""

    name: str
    media_type: str
    data: bytes


def run_attachments(
    scenario: DeclaredScenario, truth: TruthScenario | None = None, config: bytes = b""
) -> list[Attachment]:
    """The declared scenario and, where there are any, the truth and the configuration (JSON)."""
    files = {SCENARIO: encode_json(scenario), CONFIG: config}
    if truth is not None:
        files[TRUTH] = encode_json(truth)
    return [Attachment(name, "application/json", data) for name, data in files.items() if data]


def truth_of(attachments: Mapping[str, Attachment]) -> TruthScenario | None:
    """The truth part of the scenario; None where it was not known."""
    file = attachments.get(TRUTH)
    return None if file is None else decode(TruthScenario, file.data, "json")


def schemas_attachment() -> Attachment:
    """JSON Schemas of the whole wire, by message."""
    schemas = {message.__name__: json.loads(exported(message)) for message in MESSAGES}
    return Attachment(SCHEMAS, "application/schema+json", json.dumps(schemas).encode())


def hash_of(config: bytes) -> str:
    """What identifies a configuration."""
    return sha256(config).hexdigest()


def to_metadata(record: RunHeader | RunEnd) -> dict[str, str]:
    """Flat texts, as MCAP metadata must be, with a checksum of their own: MCAP gives them none."""
    entries: dict[str, str] = {}
    for name, value in msgspec.to_builtins(record).items():
        if isinstance(value, dict):
            entries |= {f"{name}.{inner}": text for inner, text in value.items()}
        else:
            entries[name] = str(value)
    return entries | {_CHECKSUM: _checksum(entries)}


def from_metadata(kind: type[T], entries: Mapping[str, str], where: str) -> T:
    """The record behind texts from a file.

    Raises:
        RecordingError: altered, incomplete, or of a newer format.
    """
    texts = dict(entries)
    if texts.pop(_CHECKSUM, None) not in (None, _checksum(texts)):
        raise RecordingError("metadata damaged: checksum differs", where=where)
    version = texts.get("format", str(FORMAT))
    if not version.isdecimal() or int(version) > FORMAT:
        raise RecordingError(
            "recorded by a newer crossfix",
            where=where,
            got=f"format {version}",
            expected=f"at most {FORMAT}",
        )
    try:
        return msgspec.convert(_nested(texts), kind, strict=False)
    except msgspec.ValidationError as error:
        raise RecordingError(f"metadata: {error}", where=where) from None


def _nested(texts: Mapping[str, str]) -> dict[str, Any]:
    nested: dict[str, Any] = {}
    for name, text in texts.items():
        outer, dot, inner = name.partition(".")
        if dot:
            nested.setdefault(outer, {})[inner] = text
        else:
            nested[name] = text
    return nested


def _checksum(entries: Mapping[str, str]) -> str:
    return f"{zlib.crc32(json.dumps(sorted(entries.items())).encode()):08x}"
