"""JSON lines: one message a line, by the names of the wire, for whoever has no Zenoh at hand.

    {"source": "radar", "t_s": 1767225601.2, "bearing_deg": [41.2, 97], "range_m": [5300, 8120.5]}
    {"topic": "navigation", "pose": {"latitude_deg": 35.9, "longitude_deg": -5.6}}

A line is a report unless `topic` says otherwise. An angle may be given in degrees under its name
with `_deg` for `_rad`, a column of one log as a plain value, the time as `t_ns` or `t_s`. The
envelope is the bridge's: `boot`, `stream`, `seq` and `step` of a line are left aside.
"""

from __future__ import annotations

from collections.abc import Iterator
from difflib import get_close_matches
from functools import cache
from math import pi
from typing import Any, NamedTuple

import msgspec
from msgspec import inspect as types

from schemas import keys
from schemas.messages import COLUMNS

from .feeds import Arrival
from .lines import Lines
from .records import Reading, RecordError

TOPICS = {t.name: t for t in (keys.REPORT, keys.NAVIGATION, keys.SOURCE, keys.RANGING)}
_ENVELOPE = ("boot", "seq", "step")
_DEGREE_RAD = pi / 180


class JsonLines:
    """Decoder of JSON lines for one carrier.

    Args:
        source: of reports that do not name theirs.
    """

    def __init__(self, carrier: str, source: str) -> None:
        self._carrier, self._source = carrier, source
        self._lines = Lines()

    def __call__(self, arrival: Arrival) -> Iterator[Reading | RecordError]:
        """A reading or a bad record for each line."""
        for line in self._lines.split(arrival):
            try:
                yield reading_of(line, self._carrier, self._source)
            except RecordError as error:
                yield error


def reading_of(line: bytes, carrier: str, source: str) -> Reading:
    """Understand one line.

    Raises:
        RecordError: no JSON object, an unknown name, a name given twice, another carrier's.
    """
    said = _object(line)
    topic = _topic(said)
    if said.pop("carrier", carrier) != carrier:
        raise RecordError(
            "carrier", "another carrier's; one bridge is one carrier", expected=carrier
        )
    for name in _ENVELOPE:
        said.pop(name, None)
    named = _source(said, topic, source)
    t_ns = _stamp(said)
    return Reading(topic, _fields(said, _shape(topic.message)), named, t_ns)


def _object(line: bytes) -> dict[str, Any]:
    try:
        said = msgspec.json.decode(line)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise RecordError("line", f"not JSON: {error}", got=line[:80]) from None
    if not isinstance(said, dict):
        raise RecordError("line", "no JSON object", got=line[:80])
    return said


def _topic(said: dict[str, Any]) -> keys.Topic:
    name = said.pop("topic", "report")
    topic = TOPICS.get(name) if isinstance(name, str) else None
    if topic is None:
        raise RecordError("topic", "nothing a carrier says", got=name, expected=" or ".join(TOPICS))
    return topic


def _source(said: dict[str, Any], topic: keys.Topic, default: str) -> str:
    """The source that a line is of; empty where it is of the carrier itself."""
    stream = said.pop("stream", default)
    if topic is keys.REPORT:
        named = said.pop("source", stream)
    elif topic is keys.SOURCE:
        named = said.setdefault("source", default)
    else:
        return ""
    if not isinstance(named, str):
        raise RecordError("source", "no name", got=named)
    return named


def _stamp(said: dict[str, Any]) -> int | None:
    """The time of a line in Unix nanoseconds; None where it has none."""
    t_ns, t_s = said.pop("t_ns", None), said.pop("t_s", None)
    if t_ns is not None and t_s is not None:
        raise RecordError("t_s", "given twice", expected="either t_ns or t_s")
    if isinstance(t_s, int | float) and 0 <= t_s < 2**63 / 1e9 and not isinstance(t_s, bool):
        whole_s = int(t_s)
        return whole_s * 10**9 + round((t_s - whole_s) * 1e9)
    if t_s is not None:
        raise RecordError("t_s", "no time", got=t_s, expected="Unix seconds")
    if isinstance(t_ns, str) and t_ns.isascii() and t_ns.isdecimal() and len(t_ns) < 20:
        t_ns = int(t_ns)
    if t_ns is None or (type(t_ns) is int and 0 <= t_ns < 2**63):
        return t_ns
    raise RecordError("t_ns", "no time", got=t_ns, expected="Unix nanoseconds, a whole number")


class _Place(NamedTuple):
    """Where a value of a line goes: field, unit factor, whether it is a column, what it holds."""

    field: str
    factor: float | None
    is_column: bool
    inner: _Shape | None


_Shape = dict[str, _Place]
"""Every name that may stand in a message."""


def _fields(said: dict[str, Any], shape: _Shape) -> dict[str, Any]:
    """The fields of a message by their names on the wire, in its units."""
    fields: dict[str, Any] = {}
    for name, value in said.items():
        place = shape.get(name)
        if place is None:
            near = get_close_matches(name[:64], shape, n=1)
            raise RecordError(name[:64], "no such field", expected="".join(near))
        if place.field in fields:
            raise RecordError(name, f"given twice: {place.field} is the same")
        fields[place.field] = _placed(name, value, place)
    return fields


def _placed(name: str, value: Any, place: _Place) -> Any:
    """A value as its field has it."""
    column = [value] if place.is_column and not isinstance(value, list | None) else value
    if place.factor is not None:
        return _scaled(name, column, place.factor)
    if place.inner is not None and isinstance(value, dict):
        return _fields(value, place.inner)
    return column


def _scaled(name: str, value: Any, factor: float) -> Any:
    """A number, or the numbers of a column, in another unit."""
    try:
        if isinstance(value, list):
            return [None if cell is None else cell * factor for cell in value]
        return None if value is None else value * factor
    except (TypeError, OverflowError):
        raise RecordError(name, "no number", got=repr(value)[:80]) from None


@cache
def _shape(message: type[msgspec.Struct]) -> _Shape:
    """The names that may stand in a message, with `_deg` for every `_rad`."""
    shape: _Shape = {}
    info = types.type_info(message)
    assert isinstance(info, types.StructType)  # noqa: S101 (what type_info gives for a Struct)
    for field in info.fields:
        is_column = message is keys.REPORT.message and field.name in COLUMNS
        shape[field.name] = _Place(field.name, None, is_column, _inner(field.type))
        if field.name.endswith("_rad"):
            degrees = field.name.removesuffix("rad") + "deg"
            shape[degrees] = _Place(field.name, _DEGREE_RAD, is_column, None)
    return shape


def _inner(kind: types.Type) -> _Shape | None:
    members = kind.types if isinstance(kind, types.UnionType) else (kind,)
    return next((_shape(m.cls) for m in members if isinstance(m, types.StructType)), None)
