"""`crossfix record`: a recorder of its own beside a run, or of whatever is said on the wire."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from crossfix.commands import ENDPOINT, HUB_TIMEOUT, Count, Name, Seconds, Timeout

Keys = Annotated[tuple[str, ...], Parameter(negative=())]


@Parameter(name="*")
@dataclass(frozen=True)
class RecordOptions:
    """What is recorded, and how.

    Attributes:
        output: recording to write; by default a new file in `recordings/`, never an old one.
        connect: endpoint of the hub.
        include: key expressions after the run, such as `report/**`; by default everything.
        exclude: key expressions of what is left out; it wins over `include`.
        regex: what the key after the run must contain besides.
        max_loss: seconds of recording that a crash may cost.
        fsync: when to wait for the disk: `flush` lets lost power cost no more than a crash.
        split_size: megabytes after which a new part is begun, that can be read alone.
        split_time: seconds of log time after which a new part is begun.
        keep: parts that are kept; older ones are deleted.
        min_free: megabytes to leave on the disk: old parts make room, else the recording ends.
        duration: seconds after which it ends.
        start_paused: record nothing until `crossfix tell record resume`.
        hub_timeout: seconds that the hub may be away before the recording ends.
        wait: seconds to wait for the run's world, whose scenario goes into the file.
        name: of this process on the wire.
    """

    output: Annotated[Path | None, Parameter(alias="-o")] = None
    connect: str = ENDPOINT
    include: Keys = ()
    exclude: Keys = ()
    regex: str = ""
    max_loss: Seconds = 0.25
    fsync: Literal["none", "flush", "end"] = "end"
    split_size: Seconds = 0.0
    split_time: Seconds = 0.0
    keep: Annotated[Count | None, Parameter(negative=())] = None
    min_free: Seconds = 0.0
    duration: Timeout | None = None
    start_paused: Annotated[bool, Parameter(negative=())] = False
    hub_timeout: Timeout = HUB_TIMEOUT
    wait: Seconds = 2.0
    name: Annotated[Name, Parameter(name="--as")] = "record"


DEFAULTS = RecordOptions()


def record(*, run: Name, options: RecordOptions = DEFAULTS) -> int:
    """Record what is said under the name of a run, in a process of its own.

    It ends with the run, or with Ctrl-C, and leaves a readable recording either way. Gaps are
    fetched from their owners. `crossfix tell` pauses it, begins a new part, or has the last
    seconds copied while it goes on.

    ```
    crossfix record --run strait --output recordings/second.mcap
    crossfix record --run strait --split-time 60 --keep 10
    ```

    Args:
        run: name of the run.
    """
    from crossfix.recording import carry_out

    return carry_out(run, options)
