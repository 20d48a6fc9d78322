"""Messages as lines of JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import msgspec

from schemas.errors import WireError
from schemas.recording.reader import Recorded


class Line(msgspec.Struct, omit_defaults=True):
    """One message of a recording.

    Attributes:
        refused: why the payload is no message of its key; then there is no `message`.
    """

    key: str
    role: str
    log_time_ns: int
    publish_time_ns: int
    sequence: int
    message: Any = None
    refused: str = ""


def lines_of(messages: Iterable[Recorded]) -> Iterator[str]:
    """Each message as one line with its end."""
    encode = msgspec.json.Encoder().encode
    for message in messages:
        yield encode(_line(message)).decode() + "\n"


def _line(message: Recorded) -> Line:
    line = Line(
        key=message.key,
        role=message.address.topic.role.value,
        log_time_ns=message.log_time_ns,
        publish_time_ns=message.publish_time_ns,
        sequence=message.sequence,
    )
    try:
        line.message = message.decode()
    except WireError as error:
        line.refused = str(error)
    return line
