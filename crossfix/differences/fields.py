"""Two messages held against each other, field by field."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from typing import Any, NamedTuple

import msgpack
import msgspec

IDENTITIES: tuple[tuple[str, ...], ...] = (
    ("id",),
    ("logs",),
    ("beacon",),
    ("carrier", "boot", "stream", "first"),
    ("carrier", "boot", "stream"),
    ("carrier", "source"),
)
"""By what the entries of a list are known; others are known by their index."""
ENCODING = "(encoding)"


class FieldChange(NamedTuple):
    """One field that differs; None stands for a field or an entry that is not there.

    Attributes:
        path: within the message, such as `tracks[t12].position_m[0]`.
    """

    path: str
    before: Any
    after: Any

    @property
    def field(self) -> str:
        """The path without its indices: what all entries of a list share."""
        parts = self.path.split("[")
        return "[]".join([parts[0], *(part.partition("]")[2] for part in parts[1:])])

    @property
    def size(self) -> float | None:
        """The difference where both are numbers."""
        if _is_number(self.before) and _is_number(self.after):
            return float(self.after - self.before)
        return None


class Rules(NamedTuple):
    """What counts as a difference.

    Attributes:
        tolerance: floats within this of each other are equal, relative to the larger one where
            that is above 1.
        ignored: names of fields that are not looked at, wherever they stand.
    """

    tolerance: float = 0.0
    ignored: Collection[str] = ()

    @property
    def are_exact(self) -> bool:
        """Whether every byte counts."""
        return not self.tolerance and not self.ignored


EXACT = Rules()


def changes(before: Any, after: Any, rules: Rules = EXACT, path: str = "") -> Iterator[FieldChange]:
    """Every field in which two unpacked messages differ, in the order of the first one."""
    if isinstance(before, dict) and isinstance(after, dict):
        for name in before | after:
            if name not in rules.ignored:
                inner = f"{path}.{name}" if path else str(name)
                yield from changes(before.get(name), after.get(name), rules, inner)
    elif isinstance(before, list) and isinstance(after, list):
        for name, was, became in _entries(before, after, rules.ignored):
            yield from changes(was, became, rules, f"{path}[{name}]")
    elif not _are_equal(before, after, rules.tolerance):
        yield FieldChange(path, before, after)


def first_difference(before: Any, after: Any) -> FieldChange:
    """The first field in which two unpacked messages differ that are not equal as bytes.

    Where all fields are equal, and only their order or the width of a number differs, the path is
    `(encoding)`.
    """
    return next(changes(before, after), FieldChange(ENCODING, before, after))


def unpacked(payload: bytes, encoding: str = "") -> Any:
    """A payload as plain values; one that cannot be read is its bytes in hexadecimal digits."""
    try:
        if "json" in encoding:
            return msgspec.json.decode(payload)
        return msgpack.unpackb(payload)
    except (ValueError, msgspec.MsgspecError, msgpack.exceptions.UnpackException):
        return payload.hex()


def _entries(
    before: Sequence[Any], after: Sequence[Any], ignored: Collection[str]
) -> Iterator[tuple[str, Any, Any]]:
    """Name and both values of each entry of two lists."""
    named = _by_identity(before, after, ignored)
    if named is not None:
        for name in named[0] | named[1]:
            yield name, named[0].get(name), named[1].get(name)
        return
    for n in range(max(len(before), len(after))):
        was, became = (side[n] if n < len(side) else None for side in (before, after))
        yield str(n), was, became


def _by_identity(
    before: Sequence[Any], after: Sequence[Any], ignored: Collection[str]
) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """Both lists by what names their entries, if that names each only once."""
    if not all(isinstance(entry, dict) for entry in (*before, *after)):
        return None
    for identity in IDENTITIES:
        fields = [field for field in identity if field not in ignored]
        if fields and all(field in entry for entry in (*before, *after) for field in fields):
            was, became = (
                {"/".join(_text(entry[field]) for field in fields): entry for entry in side}
                for side in (before, after)
            )
            if len(was) == len(before) and len(became) == len(after):
                return was, became
    return None


def _text(value: Any) -> str:
    return "+".join(map(str, value)) if isinstance(value, list) else str(value)


def _are_equal(before: Any, after: Any, tolerance: float) -> bool:
    if type(before) is float and type(after) is float:
        if before == after:
            return tolerance > 0 or math.copysign(1, before) == math.copysign(1, after)
        return abs(before - after) <= tolerance * max(1.0, abs(before), abs(after))
    if tolerance and _is_number(before) and _is_number(after) and float in (
        type(before), type(after),
    ):  # fmt: skip
        return _are_equal(float(before), float(after), tolerance)
    return type(before) is type(after) and bool(before == after)


def _is_number(value: Any) -> bool:
    return type(value) in (int, float)
