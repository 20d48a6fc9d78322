"""JSON Schema of every message, and their fields as rows for documentation.

`python -m schemas.json_schema` writes `schemas/json/<Message>.json`; with `--check` it says which
of them are not current and exits with 1.
"""

from __future__ import annotations

import argparse
import inspect
import json
import re
import sys
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from msgspec import inspect as types

from . import messages as m
from .keys import PREFIX, TOPICS, Topic

Message = type[msgspec.Struct]
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
_UNIT = re.compile(r".*_(m|mps|mps2|rad|s|ns|hz)")
_UNITS = {"mps": "m/s", "mps2": "m/s^2", "hz": "Hz"}


class Field(NamedTuple):
    """One field of a message, in words.

    Attributes:
        type: what it holds and within which bounds.
        unit: as its name says; empty where there is none.
        default: as JSON; None = required.
        description: from the docstring of the message or of its envelope; may be empty.
    """

    name: str
    type: str
    unit: str
    default: str | None
    description: str


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


def fields_of(message: Message) -> list[Field]:
    """The fields of a message in the order of the message, envelope first."""
    described = _descriptions(message)
    return [
        Field(
            field.name,
            _words(field.type),
            _unit(field.name),
            _default(field),
            described.get(field.name, ""),
        )
        for field in _struct(message).fields
    ]


def summary_of(message: Message) -> str:
    """What a message is: its docstring without the fields."""
    return _sections(message)[0]


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
    described = _descriptions(message)
    for name, schema in definition.get("properties", {}).items():
        if name in described:
            schema["description"] = described[name]


@cache
def _descriptions(message: Message) -> dict[str, str]:
    """Field -> description from the docstrings, base classes first; a sigma goes without saying."""
    names = message.__struct_fields__
    words = {n: f"one sigma of {n[6:]}." for n in names if re.fullmatch(r"sigma_\w+_\w+", n)}
    for base in reversed(message.__mro__):
        if issubclass(base, msgspec.Struct):
            words |= _entries(_sections(base)[1], names)
    return words


def _sections(message: Message) -> tuple[str, str]:
    summary, _, attributes = inspect.cleandoc(message.__doc__ or "").partition("\n\nAttributes:\n")
    return summary, attributes


def _entries(attributes: str, names: tuple[str, ...]) -> dict[str, str]:
    """Read `a, b: what they are; c: what it is.` of an Attributes section."""
    field = "|".join(names)
    head = re.compile(rf"(?:^|; )((?:{field})(?:, (?:{field}))*): ")
    described: dict[str, str] = {}
    for entry in re.split(r"\n {4}(?! )", "\n" + attributes):
        _, *parts = head.split(" ".join(entry.split()))
        for group, words in zip(parts[::2], parts[1::2], strict=True):
            described |= dict.fromkeys(group.split(", "), words)
    return described


def _struct(message: Message) -> types.StructType:
    info = types.type_info(message)
    assert isinstance(info, types.StructType)  # noqa: S101 - what type_info gives for a Struct
    return info


def _default(field: types.Field) -> str | None:
    if field.required:
        return None
    if field.default_factory is not msgspec.NODEFAULT:
        return json.dumps(field.default_factory())
    return json.dumps(field.default)


def _unit(name: str) -> str:
    match = _UNIT.fullmatch(name)
    return _UNITS.get(match[1], match[1]) if match else ""


def _words(kind: types.Type) -> str:  # noqa: PLR0911 - one line a kind
    """What a field holds, in words: `list of (number >= 0 or nil)`."""
    match kind:
        case types.UnionType(types=members):
            return " or ".join(map(_words, members))
        case types.ListType(item_type=item):
            return f"list of {_grouped(_words(item))}"
        case types.DictType(key_type=key, value_type=value):
            return f"map of {_words(key)} to {_words(value)}"
        case types.StructType(cls=cls):
            return cls.__name__
        case types.LiteralType(values=values):
            return " | ".join(map(str, values))
        case types.IntType() | types.FloatType():
            return _bounded(kind)
        case types.StrType(pattern=pattern):
            return "id" if pattern else "text"
    names = {types.BoolType: "boolean", types.BytesType: "bytes", types.NoneType: "nil"}
    return names.get(type(kind), "anything")


def _grouped(words: str) -> str:
    return f"({words})" if " or " in words or " | " in words else words


def _bounded(kind: types.IntType | types.FloatType) -> str:
    """`number > 0, <= 1e+12`; bounds that only exclude what is not finite go unsaid."""
    name = "integer" if isinstance(kind, types.IntType) else "number"
    signs = {">=": kind.ge, ">": kind.gt, "<=": kind.le, "<": kind.lt}
    bounds = [f"{s} {b:g}" for s, b in signs.items() if b is not None and abs(b) < 1e18]
    return f"{name} {', '.join(bounds)}".rstrip()


if __name__ == "__main__":
    sys.exit(main())
