"""`crossfix replay`: a recording's messages on the wire again, at their own pace or another."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from crossfix.commands import ENDPOINT, Name, Rate, Seconds, Timeout

RoleName = Literal["input", "truth", "output", "status", "control"]
Flag = Annotated[bool, Parameter(negative=())]


@Parameter(name="*")
@dataclass(frozen=True)
class ReplayOptions:
    """What is replayed, and how.

    Attributes:
        rate: multiple of the recorded pace, or `max` for as fast as it goes.
        loop: begin again at the end, until Ctrl-C.
        start: seconds of the recording to pass over; the latched values of that instant come first.
        until: seconds after the beginning of the recording at which the replay ends.
        duration: seconds of the recording that are replayed.
        start_paused: publish nothing until `crossfix tell player resume`, or space.
        delay: seconds to wait before the first message.
        clock: how often a second to publish the time of the replay under `clock/NAME`.
        remap: another name for a carrier or a source, such as `levante=l2` or
            `levante/radar=levante/r2`; the envelopes then say so too.
        role: which messages; may be repeated.
        order: as they arrived, or by the senders' stamps.
        wait_for: processes whose liveliness token must be there before the first message.
        wait_timeout: seconds to wait for them.
        as_world: play the world's part too, so that a fusion centre fuses the recording as a run.
        connect: endpoint of the hub.
        run: name of the run to publish under, by default the recorded one.
        name: of this replay on the wire.
        json: print what was done as JSON on stdout.
    """

    rate: Rate = "1"
    loop: Flag = False
    start: Seconds = 0.0
    until: Timeout | None = None
    duration: Timeout | None = None
    start_paused: Flag = False
    delay: Seconds = 0.0
    clock: Seconds = 0.0
    remap: Annotated[tuple[str, ...], Parameter(negative=())] = ()
    role: Annotated[tuple[RoleName, ...], Parameter(negative="")] = ("input",)
    order: Literal["arrival", "stamp"] = "arrival"
    wait_for: Annotated[tuple[Name, ...], Parameter(negative=())] = ()
    wait_timeout: Timeout = 30.0
    as_world: Flag = False
    connect: str = ENDPOINT
    run: Name | None = None
    name: Annotated[Name, Parameter(name="--as")] = "player"
    json: Flag = False


DEFAULTS = ReplayOptions()


def replay(recording: Path, /, *, options: ReplayOptions = DEFAULTS) -> int:
    """Publish the messages of a recording again, byte for byte, on the keys they had.

    By default only the inputs: what carriers said and when time was closed. Refuses to speak for
    a process that is alive in that run, answers for what its listeners have missed, and obeys the
    keys of the terminal and `crossfix tell`. Ctrl-C ends it.

    ```
    crossfix replay recordings/strait.mcap --rate 10
    crossfix replay recordings/strait.mcap --run again --as-world --rate max
    ```

    Args:
        recording: the MCAP file.
    """
    from crossfix.replaying.session import carry_out

    return carry_out(recording, options)
