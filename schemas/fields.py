"""The fields of a struct in words, for documentation: type, unit, default, meaning."""

from __future__ import annotations

import inspect
import re
from functools import cache
from math import inf
from typing import NamedTuple

import msgspec
from msgspec import inspect as types

Message = type[msgspec.Struct]
_UNIT = re.compile(r".*_(m|mps|mps2|rad|deg|s|ns|hz)")
_UNITS = {"mps": "m/s", "mps2": "m/s^2", "hz": "Hz"}
_NUMBERS = ("no", "one", "two", "three", "four")


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


def fields_of(message: Message) -> list[Field]:
    """The fields of a message in the order of the message, envelope first."""
    described = descriptions(message)
    return [
        Field(
            field.encode_name,
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


@cache
def descriptions(message: Message) -> dict[str, str]:
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
        return _shown(field.default_factory())
    return _shown(field.default)


def _shown(value: object) -> str:
    """A default as JSON; a table of defaults as an empty one, and no bound as such."""
    if isinstance(value, msgspec.Struct):
        return "{}"
    return "none" if value == inf else msgspec.json.encode(value).decode()


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
        case types.TupleType(item_types=items):
            kinds = dict.fromkeys(map(_words, items))
            return f"{_NUMBERS[len(items)]} of {_grouped(' or '.join(kinds))}"
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
    names |= {types.DateTimeType: "date and time"}
    return names.get(type(kind), "anything")


def _grouped(words: str) -> str:
    return f"({words})" if " or " in words or " | " in words else words


def _bounded(kind: types.IntType | types.FloatType) -> str:
    """`number > 0, <= 1e+12`; bounds that only exclude what is not finite go unsaid."""
    name = "integer" if isinstance(kind, types.IntType) else "number"
    signs = {">=": kind.ge, ">": kind.gt, "<=": kind.le, "<": kind.lt}
    bounds = [f"{s} {b:g}" for s, b in signs.items() if b is not None and abs(b) < 1e18]
    return f"{name} {', '.join(bounds)}".rstrip()
