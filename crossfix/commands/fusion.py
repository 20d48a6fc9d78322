"""`crossfix fusion`: the fusion centre of a run with its recorder, started by hand."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from crossfix.commands import ENDPOINT, FILES, HUB_TIMEOUT, FileOptions, Name, Seconds, Timeout


def fusion(
    *,
    run: Name,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    connect: str = ENDPOINT,
    max_loss: Seconds = 0.25,
    lateness: Seconds = 0.2,
    start_timeout: Timeout = 600.0,
    hub_timeout: Timeout = HUB_TIMEOUT,
    files: FileOptions = FILES,
) -> int:
    """Fuse what the carriers of a run publish, and record all of it.

    A hub that comes too late, or goes and stays away, is an error; the recording is whole up to
    there.

    ```
    crossfix fusion --run strait -o recordings/strait.mcap --connect tcp/192.0.2.7:7447
    ```

    Args:
        run: name of the run.
        output: recording to write; by default a new file in `recordings/`, never an old one.
        connect: endpoint of the hub.
        max_loss: seconds of recording that a crash may cost.
        lateness: seconds after which a step of a paced run is closed.
        start_timeout: seconds to wait for the hub and the world.
        hub_timeout: seconds that the hub may be away before this ends.
        files: how the recording lies on the disk.
    """
    from crossfix.launch import become
    from crossfix.new_file import new_recording, require_new
    from schemas.keys import require_id

    of_files = files.arguments()
    recording = require_new(output) if output else new_recording(require_id(run))
    print(f"recording: {recording}", file=sys.stderr)
    arguments = ["--run", run, "--output", str(recording), "--connect", connect]
    arguments += ["--max-loss", str(max_loss), "--lateness", str(lateness)]
    arguments += ["--start-timeout", str(start_timeout), "--hub-timeout", str(hub_timeout)]
    return become("fusion_center", [*arguments, *of_files])
