"""Pages of documentation made of the tables that the code runs on, so that they cannot be stale."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import msgspec
from msgspec import inspect as types

from .fields import Message, fields_of, summary_of


def written_or_checked(
    path: Path, text: str, command: str, arguments: Sequence[str] | None = None
) -> int:
    """Write a page, or with `--check` say whether it is current; the exit code.

    Args:
        command: what makes the page, such as `python -m schemas.wire_page`.
    """
    parser = argparse.ArgumentParser(prog=command, description=f"Write docs/{path.name}.")
    parser.add_argument("--check", action="store_true", help="write nothing, say if it is stale")
    if not parser.parse_args(arguments).check:
        path.write_text(text, encoding="utf-8")
        return 0
    if path.exists() and path.read_text(encoding="utf-8") == text:
        return 0
    sys.stderr.write(f"docs/{path.name} is not current: {command}\n")
    return 1


def section(struct: Message, known: set[str], after: str = "") -> str:
    """A struct with all its fields.

    Args:
        known: names that have a section on the page, and are links.
        after: said after its summary.
    """
    rows = (
        (
            f"`{field.name}`",
            linked(field.type, known),
            field.unit,
            "*required*" if field.default is None else f"`{field.default}`",
            field.description,
        )
        for field in fields_of(struct)
    )
    fields = table(("field", "holds", "unit", "default", "is"), rows)
    return f"### {struct.__name__}\n\n{summary_of(struct)}{after}\n\n{fields}"


def parts(structs: Iterable[Message]) -> set[Message]:
    """All that structs are made of and that has fields of its own."""
    found: set[Message] = set()
    for struct in structs:
        for field in msgspec.structs.fields(struct):
            inner = set(_structs(types.type_info(field.type))) - found
            found |= inner | parts(inner)
    return found


def _structs(kind: types.Type) -> Iterator[Message]:
    match kind:
        case types.UnionType(types=members):
            for member in members:
                yield from _structs(member)
        case types.ListType(item_type=item):
            yield from _structs(item)
        case types.DictType(value_type=value):
            yield from _structs(value)
        case types.StructType(cls=cls):
            yield cls


def linked(words: str, known: set[str]) -> str:
    """What a field holds, each known name a link to its own section."""
    named = re.sub(
        r"\b[A-Z]\w+",
        lambda word: f"[{word[0]}](#{word[0].lower()})" if word[0] in known else word[0],
        words,
    )
    return re.sub(r"(number|integer) >= (-\S+), <= (\S+)", _between, named)


def _between(bounds: re.Match[str]) -> str:
    kind, low, high = bounds.groups()
    return f"{kind} within {high}" if low == f"-{high}" else bounds[0]


def table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Rows under headings, in Markdown."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "".join(
        f"| {' | '.join(c.replace('|', chr(92) + '|') for c in line)} |\n" for line in lines
    )
