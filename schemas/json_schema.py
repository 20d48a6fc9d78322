"""JSON Schema of every message.

`python -m schemas.json_schema` writes `schemas/json/<Message>.json`; with `--check` it says which
of them are not current and exits with 1.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import msgspec

from . import messages as m
from .fields import Message, descriptions, summary_of
from .keys import PREFIX, TOPICS, Topic

VERSION = PREFIX.rpartition("@")[2]
DIRECTORY = Path(__file__).parent / "json"
MESSAGES: tuple[Message, ...] = tuple(
    sorted(
        {t.message for t in TOPICS}
        | {m.Answer, m.BackfillReply, m.PlayerStatus, m.RecorderStatus, m.Statistics},
        key=lambda message: message.__name__,
    )
)
"""Every message that travels or is recorded on its own."""


def schema_of(what: Topic | Message) -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of a message, complete in itself.

    64-bit integers are integers in it, though JSON samples may carry them as decimal strings;
    bytes are strings in base 64, and of kind bin in MessagePack.
    """
    message = what.message if isinstance(what, Topic) else what
    _, definitions = msgspec.json.schema_components((message,), ref_template="#/$defs/{name}")
    for name, definition in definitions.items():
        _describe(definition, getattr(m, name))
    root = definitions.pop(message.__name__)
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:crossfix:{VERSION}:{message.__name__}",
        **root,
    }
    return {**schema, "$defs": definitions} if definitions else schema


def exported(message: Message) -> bytes:
    """The schema file of a message, as committed and as registered in recordings."""
    return (DIRECTORY / f"{message.__name__}.json").read_bytes()


def write(directory: Path = DIRECTORY) -> None:
    """Write the schema file of every message; files of messages that are no more go."""
    directory.mkdir(exist_ok=True)
    for name in stale(directory):
        (directory / name).unlink(missing_ok=True)
    for name, text in _files().items():
        (directory / name).write_text(text, encoding="utf-8")


def stale(directory: Path = DIRECTORY) -> list[str]:
    """Names of schema files that are missing, differ from the messages, or belong to none."""
    found = {path.name: path.read_text(encoding="utf-8") for path in directory.glob("*.json")}
    wanted = _files()
    return sorted(n for n in found.keys() | wanted.keys() if found.get(n) != wanted.get(n))


def main(arguments: list[str] | None = None) -> int:
    """Write the schema files, or check that they are current; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m schemas.json_schema", description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing, say what is stale")
    if not parser.parse_args(arguments).check:
        write()
        return 0
    for name in (names := stale()):
        sys.stderr.write(f"schemas/json/{name} is not current: python -m schemas.json_schema\n")
    return 1 if names else 0


def _files() -> dict[str, str]:
    return {f"{t.__name__}.json": json.dumps(schema_of(t), indent=1) + "\n" for t in MESSAGES}


def _describe(definition: dict[str, Any], message: Message) -> None:
    """Put the words of the docstring where JSON Schema has a place for them."""
    definition["description"] = summary_of(message)
    described = descriptions(message)
    for name, schema in definition.get("properties", {}).items():
        if name in described:
            schema["description"] = described[name]


if __name__ == "__main__":
    sys.exit(main())
