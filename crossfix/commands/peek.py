"""`crossfix peek`: what passes on the wire, read with plain `msgpack` as a stranger would."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from crossfix.commands import ENDPOINT, Count

if TYPE_CHECKING:
    from rich.console import Console

    from schemas.bus.interface import Inbox, Sample

WAIT_S = 0.2
HUB_S = 3.0
SHOWN_ITEMS = 8
"""Longer lists are cut, for people only."""


def peek(
    key: str = "**",
    /,
    *,
    connect: str = ENDPOINT,
    run: str = "*",
    count: Count | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> None:
    """Print messages as they pass, until Ctrl-C.

    Nothing is checked against our message types: what is printed is what a program in any
    language would read. Messages published before this began are not seen.

    ```
    crossfix peek 'correction/**' --run strait
    crossfix peek report/levante/radar --count 1 --json
    ```

    Args:
        key: key expression after the run, such as `report/**`; `*` is one chunk, `**` any number
            of them. One that begins with `crossfix/` is taken as it is.
        connect: endpoint of the hub.
        run: name of the run, by default every one.
        count: stop after so many messages.
        as_json: one JSON object a line, with key, encoding and message.
    """
    from rich.console import Console

    from schemas.bus.interface import Inbox
    from schemas.bus.zenoh_bus import open_bus

    inbox: Inbox[Sample] = Inbox()
    console = Console(soft_wrap=as_json)
    with open_bus(connect, HUB_S) as bus:
        bus.subscribe(_expression(run, key), inbox)
        Console(stderr=True).print(f"listening to {_expression(run, key)}", style="dim")
        for sample in _first(count, inbox):
            _show(sample, console, as_json=as_json)
    if inbox.drops:
        Console(stderr=True).print(f"{inbox.drops} messages were too many to show", style="yellow")


def read(payload: bytes, encoding: str) -> Any:
    """The message in a payload, as maps and lists; text that says why where there is none."""
    import json

    import msgpack

    try:
        if "json" in encoding:
            return json.loads(payload)
        return msgpack.unpackb(payload, object_pairs_hook=_named, strict_map_key=False)
    except (ValueError, msgpack.UnpackException) as error:
        return f"unreadable: {type(error).__name__}: {error}"


def _named(pairs: list[tuple[object, object]]) -> dict[str, object]:
    """A map as JSON can hold it: a stranger's keys may be anything."""
    return {key if isinstance(key, str) else repr(key): value for key, value in pairs}


def _as_text(value: object) -> str:
    return value.hex() if isinstance(value, bytes) else repr(value)


def _expression(run: str, key: str) -> str:
    from schemas.keys import PREFIX, require_id

    name = run if run == "*" else require_id(run)
    return key if key.startswith("crossfix/") else f"{PREFIX}/{name}/{key}"


def _first(count: int | None, inbox: Inbox[Sample]) -> Iterator[Sample]:
    shown = 0
    while count is None or shown < count:
        for sample in inbox.take(WAIT_S)[: None if count is None else count - shown]:
            shown += 1
            yield sample


def _show(sample: Sample, console: Console, *, as_json: bool) -> None:
    import json

    from rich.pretty import Pretty
    from rich.text import Text

    message = read(sample.payload, sample.encoding)
    if as_json:
        line = {"key": sample.key, "encoding": sample.encoding, "message": message}
        print(json.dumps(line, default=_as_text), flush=True)
    else:
        console.print(Text(sample.key, style="bold cyan"))
        console.print(Pretty(message, max_length=SHOWN_ITEMS, indent_guides=False))
