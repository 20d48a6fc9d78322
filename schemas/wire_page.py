"""The wire as a page for people: `docs/wire.md`, made of the tables that the code runs on.

`python -m schemas.wire_page` writes it; with `--check` it says whether it is current, and exits
with 1 where it is not.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import msgspec
from msgspec import inspect as types

from . import keys
from .codec import MAX_PAYLOAD_BYTES
from .json_schema import MESSAGES, Message, fields_of, summary_of
from .qos import CONTROL, DATA, STATUS

PAGE = Path(__file__).parents[1] / "docs" / "wire.md"
_TAKEN_PROCESSES = ", ".join(f"`{name}`" for name in keys.RESERVED_PROCESSES)
_TAKEN_STREAMS = ", ".join(f"`{name}`" for name in keys.RESERVED_STREAMS)
_INTRODUCTION = f"""\
# The wire

What travels between the processes of a run, complete: `python -m schemas.wire_page` makes this page
of the tables in [schemas/keys.py](../schemas/keys.py) and of the messages in
[schemas/messages](../schemas/messages). [publishing.md](publishing.md) shows how to take part.

- A key is `{keys.PREFIX}/RUN/` and what the table of topics says. Every name in it matches
  `[a-z0-9_-]{{1,32}}`, and a key has at most {keys.MAX_KEY_BYTES} bytes. `@v1` is the version:
  wildcards do not cross it.
- A payload is a MessagePack map with named fields, under the encoding
  `application/msgpack;crossfix.MESSAGE`; or the same as JSON under
  `application/json;crossfix.MESSAGE`, where 64-bit integers may be strings of digits and bytes are
  base 64. At most {MAX_PAYLOAD_BYTES // 2**20} MB. A field with a default may be left out; a field
  that is not known is skipped. The same as JSON Schema: [schemas/json](../schemas/json).
- Units are SI and radians, and names carry them. Bearings are clockwise from the sender's own
  north, `sigma_x` is one sigma of `x`, `t_ns` is Unix nanoseconds by the sender's own clock.
- A carrier is a process of its name. {_TAKEN_PROCESSES} are taken, and no source is called
  {_TAKEN_STREAMS}.
- A process is there while it holds the liveliness token `alive/PROCESS/BOOT`, a new boot at every
  start.
- *Latched* topics have a queryable of the last value at their key. Topics with the rate *query* are
  asked, not published: the payload is the question, and one in JSON is answered in JSON. `backfill`
  answers with a
  [BackfillReply](#backfillreply), `command` and `player` with an [Answer](#answer), and a bridge at
  its `state` with the [ProcessState](#processstate) of now.
"""


def page() -> str:
    """The whole page."""
    sections = [_INTRODUCTION, *_topics(), *_qos(), *_covariances(), "## Messages\n"]
    told = [*dict.fromkeys(topic.message for topic in keys.TOPICS), *MESSAGES]
    messages = list(dict.fromkeys(told))
    parts = sorted(_parts(messages) - set(messages), key=lambda part: part.__name__)
    known = {message.__name__ for message in (*messages, *parts)}
    sections += [_section(message, known) for message in messages]
    sections.append("## Parts of messages\n")
    sections += [_section(part, known) for part in parts]
    return "\n".join(sections)


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page, or check that it is current; the exit code."""
    parser = argparse.ArgumentParser(prog="python -m schemas.wire_page", description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing, say if it is stale")
    if not parser.parse_args(arguments).check:
        PAGE.write_text(page(), encoding="utf-8")
        return 0
    if PAGE.exists() and PAGE.read_text(encoding="utf-8") == page():
        return 0
    sys.stderr.write("docs/wire.md is not current: python -m schemas.wire_page\n")
    return 1


def _topics() -> Iterator[str]:
    """Which message travels where, how often, and what it is to a recording."""
    yield "## Topics\n"
    yield _table(
        ("key, after the run", "message", "role", "rate", "QoS", "latched", "recorded"),
        (
            (
                f"`{topic.template}`",
                _linked(topic.message.__name__, {topic.message.__name__}),
                topic.role.value,
                topic.rate,
                topic.qos.name,
                "yes" if topic.latched else "",
                "yes" if topic.recorded else "",
            )
            for topic in keys.TOPICS
        ),
    )
    yield "Roles: *input* is fused, *output* is what the fusion makes of it, *truth* is for"
    yield "simulated carriers and the recorder, *status* and *control* steer and tell.\n"


def _qos() -> Iterator[str]:
    yield "## Quality of service\n"
    yield _table(
        ("profile", "priority", "express"),
        (
            (profile.name, profile.priority, "yes" if profile.express else "")
            for profile in (CONTROL, DATA, STATUS)
        ),
    )
    yield "Congestion control is DROP throughout: nobody is held up by who does not read. What was"
    yield "dropped is asked for again (`backfill`).\n"


def _covariances() -> Iterator[str]:
    yield "## Order of covariances\n"
    yield "Each is the upper triangle of the matrix, row by row, positive definite. Where fewer"
    yield "coordinates are given, the last ones are left out.\n"
    yield _table(
        ("covariance", "rows"),
        (
            (f"`{name}`", ", ".join(f"`{row}`" for row in rows))
            for name, rows in keys.COVARIANCES.items()
        ),
    )


def _section(message: Message, known: set[str]) -> str:
    """A message with all its fields."""
    rows = (
        (
            f"`{field.name}`",
            _linked(field.type, known),
            field.unit,
            "*required*" if field.default is None else f"`{field.default}`",
            field.description,
        )
        for field in fields_of(message)
    )
    table = _table(("field", "holds", "unit", "default", "is"), rows)
    where = [f"`{topic.template}`" for topic in keys.TOPICS if topic.message is message]
    travels = f" On {', '.join(where)}." if where else ""
    return f"### {message.__name__}\n\n{summary_of(message)}{travels}\n\n{table}"


def _parts(messages: Iterable[Message]) -> set[Message]:
    """Everything a message is made of that has fields of its own."""
    found: set[Message] = set()
    for message in messages:
        for field in msgspec.structs.fields(message):
            parts = set(_structs(types.type_info(field.type))) - found
            found |= parts | _parts(parts)
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


def _linked(words: str, known: set[str]) -> str:
    """What a field holds, each part a link to its own section."""
    named = re.sub(
        r"\b[A-Z]\w+",
        lambda word: f"[{word[0]}](#{word[0].lower()})" if word[0] in known else word[0],
        words,
    )
    return re.sub(r"(number|integer) >= (-\S+), <= (\S+)", _between, named)


def _between(bounds: re.Match[str]) -> str:
    kind, low, high = bounds.groups()
    return f"{kind} within {high}" if low == f"-{high}" else bounds[0]


def _table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [headings, ["---"] * len(headings), *rows]
    return "".join(
        f"| {' | '.join(c.replace('|', chr(92) + '|') for c in line)} |\n" for line in lines
    )


if __name__ == "__main__":
    sys.exit(main())
