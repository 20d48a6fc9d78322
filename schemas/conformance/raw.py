"""A payload as maps and lists, without our message types: what its author really wrote."""

from __future__ import annotations

from collections.abc import Iterator
from difflib import get_close_matches
from math import isfinite
from typing import Any, NamedTuple

import msgspec

from ..messages import COLUMNS

MAX_DEPTH = 6
SHOWN = 60


class Head(NamedTuple):
    """As much of an envelope as can be believed of a message that was refused."""

    boot: str
    seq: int
    t_ns: int


def unpacked(payload: bytes, encoding: str) -> dict[str, Any] | None:
    """The map in a payload; None where there is none."""
    try:
        if "json" in encoding:
            value = msgspec.json.decode(payload)
        else:
            value = msgspec.msgpack.decode(payload)
    except (ValueError, RecursionError, OverflowError, TypeError):
        return None
    if not isinstance(value, dict) or not all(isinstance(name, str) for name in value):
        return None
    return value


def head(raw: dict[str, Any]) -> Head | None:
    """Boot, seq and stamp, if they are what they should be."""
    boot, seq, t_ns = raw.get("boot"), raw.get("seq"), raw.get("t_ns")
    if not (isinstance(boot, str) and _is_count(seq) and _is_count(t_ns)):
        return None
    return Head(boot, int(seq), int(t_ns))  # type: ignore[arg-type]


def cells(raw: dict[str, Any], column: str) -> list[float]:
    """The numbers of a column, however the rest of it looks."""
    values = raw.get(column)
    if not isinstance(values, list):
        return []
    return [float(v) for v in values if isinstance(v, int | float) and not isinstance(v, bool)]


def ragged(raw: dict[str, Any]) -> str:
    """Which columns differ in length, in words; empty if none do."""
    lengths = {name: len(raw[name]) for name in COLUMNS if isinstance(raw.get(name), list)}
    if len(set(lengths.values())) < 2:
        return ""
    return ", ".join(f"{name} has {length}" for name, length in sorted(lengths.items()))


def not_finite(value: Any, path: str = "", depth: int = 0) -> str:
    """Where a number is not finite; empty if all are."""
    if isinstance(value, float):
        return "" if isfinite(value) else f"{path} is {value}"
    if depth > MAX_DEPTH:
        return ""
    found = (not_finite(inner, where, depth + 1) for where, inner in _inner(value, path))
    return next(filter(None, found), "")


def unknown_fields(raw: dict[str, Any], message: msgspec.Struct, path: str = "") -> Iterator[str]:
    """Fields that are in no message of this type, each with the nearest that is."""
    known = message.__struct_fields__
    for name, value in raw.items():
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            yield f"{path}{name}"[:SHOWN] + hint
            continue
        inner = getattr(message, name)
        if isinstance(inner, msgspec.Struct) and isinstance(value, dict):
            yield from unknown_fields(value, inner, f"{path}{name}.")


def _inner(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        yield from ((f"{path}.{name}".strip("."), inner) for name, inner in value.items())
    elif isinstance(value, list):
        yield from ((f"{path}[{n}]", inner) for n, inner in enumerate(value))


def _is_count(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**63
