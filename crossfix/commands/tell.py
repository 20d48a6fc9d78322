"""`crossfix tell`: commands to a recorder or a replay that is under way."""

from __future__ import annotations

from typing import Annotated, Literal

from cyclopts import Parameter

from crossfix.commands import ENDPOINT, Name, Seconds

HUB_S = 5.0
Command = Literal["pause", "resume", "status", "step", "seek", "rate", "stop", "split", "snapshot"]


def tell(
    who: Name,
    command: Command,
    value: Annotated[str | None, Parameter(show_default=False)] = None,
    /,
    *,
    run: Name,
    last: Seconds = 30.0,
    connect: str = ENDPOINT,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Tell a recorder or a replay what to do, and show how it stands.

    A replay is called `player` unless told otherwise, a recorder of its own `record`, the one of
    a fusion centre `recorder`. Exit code 1: it refused; 2: nobody of that name answered.

    ```
    crossfix tell player seek 12.5 --run strait
    crossfix tell record snapshot incident.mcap --last 30 --run strait
    ```

    Args:
        who: name of the process.
        command: both know pause, resume, status; a replay step, seek, rate, stop; a recorder
            split and snapshot.
        value: of seek, seconds from the start of the recording, or Unix nanoseconds; of rate, a
            number or `max`; of snapshot, the name of the new file beside the recording.
        run: name of the run.
        last: of snapshot, how many seconds of log time it holds.
        connect: endpoint of the hub.
        as_json: print the answer as JSON.
    """
    from crossfix.telling import ask, described
    from schemas.bus.zenoh_bus import open_bus

    with open_bus(connect, HUB_S) as bus:
        answer = ask(bus, run, who, command, value, last)
    if as_json:
        import msgspec

        print(msgspec.json.encode(answer).decode())
    else:
        print(described(answer))
    return 0 if answer.taken else 1
