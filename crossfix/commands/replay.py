"""`crossfix replay`: a recording's messages on the wire again, at their own pace or another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from crossfix.commands import ENDPOINT, Name, Rate

HUB_S = 3.0
RoleName = Literal["input", "truth", "output", "status", "control"]


def replay(
    recording: Path,
    /,
    *,
    rate: Rate = "1",
    connect: str = ENDPOINT,
    role: Annotated[tuple[RoleName, ...], Parameter(negative="")] = ("input",),
    run: Name | None = None,
) -> None:
    """Publish the messages of a recording again, byte for byte, on the keys they had.

    By default only the inputs: what carriers said and when time was closed. Refuses to speak for
    a process that is alive in that run. Ctrl-C ends it.

    ```
    crossfix replay recordings/strait.mcap --rate 10
    ```

    Args:
        recording: the MCAP file.
        rate: multiple of the recorded pace, or `max` for as fast as it goes.
        connect: endpoint of the hub.
        role: which messages; may be repeated.
        run: name of the run to publish under, by default the recorded one.
    """
    from rich.console import Console

    from crossfix.replaying import Pace, publish, refuse_if_alive, showing
    from schemas.bus.zenoh_bus import open_bus
    from schemas.keys import Role
    from schemas.recording.reader import open_recording

    console = Console(stderr=True, highlight=False)
    with open_recording(recording) as opened, open_bus(connect, HUB_S) as bus:
        name = run or opened.header.run
        refuse_if_alive(opened, name, bus)
        messages = opened.messages(roles=[Role(one) for one in role])
        with showing(opened, console) as show:
            sent = publish(messages, name, bus, Pace(None if rate == "max" else float(rate)), show)
        console.print(
            f"{sent.messages} messages of run {name} in {sent.took_s:.1f} s, "
            f"at most {1000 * sent.latest_s:.1f} ms late"
        )
