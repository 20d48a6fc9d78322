"""The wire as a page for people: `docs/wire.md`, made of the tables that the code runs on.

`python -m schemas.wire_page` writes it; with `--check` it says whether it is current, and exits
with 1 where it is not.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from . import keys
from .codec import MAX_PAYLOAD_BYTES
from .fields import Message
from .json_schema import MESSAGES
from .pages import linked, parts, section, table, written_or_checked
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
    inner = sorted(parts(messages) - set(messages), key=lambda part: part.__name__)
    known = {message.__name__ for message in (*messages, *inner)}
    sections += [section(message, known, _travels(message)) for message in messages]
    sections.append("## Parts of messages\n")
    sections += [section(part, known) for part in inner]
    return "\n".join(sections)


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page, or check that it is current; the exit code."""
    return written_or_checked(PAGE, page(), "python -m schemas.wire_page", arguments)


def _topics() -> Iterator[str]:
    """Which message travels where, how often, and what it is to a recording."""
    yield "## Topics\n"
    yield table(
        ("key, after the run", "message", "role", "rate", "QoS", "latched", "recorded"),
        (
            (
                f"`{topic.template}`",
                linked(topic.message.__name__, {topic.message.__name__}),
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
    yield table(
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
    yield table(
        ("covariance", "rows"),
        (
            (f"`{name}`", ", ".join(f"`{row}`" for row in rows))
            for name, rows in keys.COVARIANCES.items()
        ),
    )


def _travels(message: Message) -> str:
    where = [f"`{topic.template}`" for topic in keys.TOPICS if topic.message is message]
    return f" On {', '.join(where)}." if where else ""


if __name__ == "__main__":
    sys.exit(main())
