"""64-bit integers in JSON: where a message has one, a decimal string is taken for it.

JavaScript and others lose the last digits of a large number; they may send it as text.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from typing import Any

import msgspec
from msgspec import inspect

_DECIMAL = re.compile(r"-?[0-9]{1,19}")
Restore = Callable[[Any], Any]


@cache
def restorer(message: type[msgspec.Struct]) -> Restore:
    """A function from decoded JSON to the same with integers where this message has integers."""
    return _restore(inspect.type_info(message), {}) or _unchanged


def _restore(kind: inspect.Type, seen: dict[type, dict[str, Restore]]) -> Restore | None:
    """How to restore a value of this type; None where it holds no integer."""
    if isinstance(kind, inspect.IntType):
        return _integer
    if isinstance(kind, inspect.UnionType):
        return _of_union(kind, seen)
    if isinstance(kind, inspect.ListType):
        item = _restore(kind.item_type, seen)
        return item and (lambda value: [item(v) for v in value] if _is(value, list) else value)
    if isinstance(kind, inspect.DictType):
        entry = _restore(kind.value_type, seen)
        return entry and (
            lambda value: {k: entry(v) for k, v in value.items()} if _is(value, dict) else value
        )
    return _of_struct(kind, seen) if isinstance(kind, inspect.StructType) else None


def _of_union(kind: inspect.UnionType, seen: dict[type, dict[str, Restore]]) -> Restore | None:
    """A union that may hold text keeps it: nobody can tell which was meant."""
    if any(isinstance(t, inspect.StrType) for t in kind.types):
        return None
    found = [r for t in kind.types if (r := _restore(t, seen))]
    return found[0] if found else None


def _of_struct(kind: inspect.StructType, seen: dict[type, dict[str, Restore]]) -> Restore | None:
    if kind.cls not in seen:
        fields = seen[kind.cls] = {}
        for field in kind.fields:
            if restore := _restore(field.type, seen):
                fields[field.encode_name] = restore
    fields = seen[kind.cls]
    if not fields:
        return None

    def restore_fields(value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        return {k: fields[k](v) if k in fields else v for k, v in value.items()}

    return restore_fields


def _integer(value: Any) -> Any:
    return int(value) if isinstance(value, str) and _DECIMAL.fullmatch(value) else value


def _unchanged(value: Any) -> Any:
    return value


def _is(value: Any, kind: type) -> bool:
    return isinstance(value, kind)
