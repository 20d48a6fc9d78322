"""A parsed TOML tree to a `ScenarioFile`, with errors that name file, key, got and expected."""

from __future__ import annotations

import re
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any, NamedTuple

import msgspec
from msgspec import inspect

from schemas.errors import ScenarioError

from .file import ScenarioFile

_AT = re.compile(r"(?P<what>.*?)(?: - at (?P<key>`key` in )?`\$(?P<path>.*)`)?", re.DOTALL)
_STEP = re.compile(r"\.(?P<name>[^.\[]+)|\[(?P<index>\d+|\.\.\.)\]")
_ID = re.compile(r"[a-z0-9_-]{1,32}")
_ID_PATTERN = "matching regex '^[a-z0-9_-]{1,32}$(?!\\\\n)'"


class _Place(NamedTuple):
    """Where in the file: the dotted key, what stands there, and the type it should have."""

    key: str
    value: Any
    kind: inspect.Type


def validated(tree: dict[str, Any], where: str) -> ScenarioFile:
    """The file as typed tables.

    Args:
        where: the file, as errors name it.

    Raises:
        ScenarioError: an unknown or missing key, or a value of the wrong type or out of range.
    """
    try:
        return msgspec.convert(tree, ScenarioFile)
    except msgspec.ValidationError as error:
        raise _explained(str(error), tree, where) from None


def nearest(name: str, known: Sequence[str]) -> str:
    """What `name` was probably meant to be, else all that is known."""
    close = get_close_matches(name, known, n=1)
    return f"{close[0]} (the nearest known)" if close else "one of " + ", ".join(sorted(known))


def key_of(tree: dict[str, Any], *path: str | int) -> str:
    """The dotted key of a place as `--set` takes it: items of lists by their names."""
    steps: list[str] = []
    value: Any = tree
    for step in path:
        value = value[step]
        steps.append(step_to(step, value))
    return ".".join(steps)


def step_to(step: str | int, value: Any) -> str:
    """The part of a dotted key that leads to a value: of an item of a list its name, if any."""
    name = value.get("name") if isinstance(step, int) and isinstance(value, dict) else None
    return name if isinstance(name, str) and _ID.fullmatch(name) else str(step)


def _explained(message: str, tree: dict[str, Any], where: str) -> ScenarioError:
    match = _AT.fullmatch(message)
    what, path = (match["what"], match["path"] or "") if match else (message, "")
    place = _place(path, tree)
    at = f"{where}: {place.key}" if place.key else where
    inside = f"{at}." if place.key else f"{where}: "
    if unknown := re.search(r"unknown field `(.*)`", what):
        expected = nearest(unknown[1], _known_keys(place))
        return ScenarioError(
            "unknown key", where=inside + unknown[1], got=unknown[1], expected=expected
        )
    if missing := re.search(r"missing required field `(.*)`", what):
        choices = _choices(place.kind) if missing[1] == "kind" else []
        expected = nearest("", choices) if choices else "a value"
        return ScenarioError("missing key", where=inside + missing[1], expected=expected)
    if match and match["key"]:
        bad = next(k for k in place.value if not _ID.fullmatch(k))
        return ScenarioError("not a name", where=inside + bad, got=bad, expected=_wording(what))
    return ScenarioError("wrong value", where=at, got=place.value, expected=_expected(what, place))


def _expected(what: str, place: _Place) -> str:
    if what.startswith("Expected"):
        return _wording(what)
    if isinstance(place.kind, inspect.DateTimeType):
        return "a time such as 2026-01-01T00:00:00Z"
    choices = _choices(place.kind)
    return nearest(str(place.value), choices) if choices else what


def _wording(what: str) -> str:
    """What msgspec expected, without its quotes and its regular expression."""
    text = what.removeprefix("Expected ").split(", got ")[0].replace("`", "")
    return text.replace(_ID_PATTERN, "of [a-z0-9_-], 1 to 32 of them")


def _place(path: str, tree: dict[str, Any]) -> _Place:
    """Follow a path of msgspec's such as `.carriers[0].name` through tree and types."""
    place, steps = _Place("", tree, inspect.type_info(ScenarioFile)), list[str | int]()
    for match in _STEP.finditer(path):
        step: str | int = match["name"] or match["index"]
        if step == "...":
            step = _culprit(place)
        elif match["index"]:
            step = int(match["index"])
        steps.append(step)
        place = _inside(place, step)
    return place._replace(key=key_of(tree, *steps))


def _inside(place: _Place, step: str | int) -> _Place:
    """One step further in."""
    kind = _plain(place.kind, place.value)
    if isinstance(kind, inspect.StructType):
        fields = {f.encode_name: f.type for f in kind.fields}
        inner = fields.get(str(step), place.kind)  # the tag: its choices are the union's
    elif isinstance(kind, inspect.ListType):
        inner = kind.item_type
    elif isinstance(kind, inspect.TupleType):
        inner = kind.item_types[int(step)]
    else:
        inner = kind.value_type if isinstance(kind, inspect.DictType) else kind
    return _Place("", place.value[step], inner)


def _culprit(place: _Place) -> str:
    """Which key of a table with free keys holds the wrong value; msgspec does not say."""
    kind = _plain(place.kind, place.value)
    limits = kind.value_type if isinstance(kind, inspect.DictType) else inspect.AnyType()
    return next(str(key) for key, value in place.value.items() if not _fits(value, limits))


def _fits(value: Any, kind: inspect.Type) -> bool:
    if isinstance(kind, inspect.TupleType):
        length = len(kind.item_types)
        return (
            isinstance(value, list)
            and len(value) == length
            and all(_fits(v, k) for v, k in zip(value, kind.item_types, strict=True))
        )
    if not isinstance(kind, inspect.FloatType):
        return True
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return (
        number and (kind.ge is None or value >= kind.ge) and (kind.le is None or value <= kind.le)
    )


def _plain(kind: inspect.Type, value: Any) -> inspect.Type:
    """Of a union the member that `value` stands for."""
    if not isinstance(kind, inspect.UnionType):
        return kind
    members = [t for t in kind.types if not isinstance(t, inspect.NoneType)]
    tag = value.get("kind") if isinstance(value, dict) else None
    tagged = [t for t in members if isinstance(t, inspect.StructType) and t.tag == tag]
    return (tagged or members)[0]


def _known_keys(place: _Place) -> list[str]:
    kind = _plain(place.kind, place.value)
    if not isinstance(kind, inspect.StructType):
        return []
    return [f.encode_name for f in kind.fields] + ([kind.tag_field] if kind.tag_field else [])


def _choices(kind: inspect.Type) -> list[str]:
    """The words that may stand for a value of this type: literals, or the tags of a union."""
    if isinstance(kind, inspect.LiteralType):
        return [str(value) for value in kind.values]
    members = kind.types if isinstance(kind, inspect.UnionType) else (kind,)
    return [str(t.tag) for t in members if isinstance(t, inspect.StructType) and t.tag]
