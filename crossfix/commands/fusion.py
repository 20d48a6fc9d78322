"""`crossfix fusion`: the fusion centre of a run with its recorder, started by hand."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from crossfix.commands import ENDPOINT, Name, Seconds, Timeout


def fusion(
    *,
    run: Name,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    connect: str = ENDPOINT,
    max_loss: Seconds = 0.25,
    lateness: Seconds = 0.2,
    start_timeout: Timeout = 600.0,
) -> int:
    """Fuse what the carriers of a run publish, and record all of it.

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
    """
    from crossfix.launch import become
    from crossfix.new_file import new_recording, require_new
    from schemas.keys import require_id

    recording = require_new(output) if output else new_recording(require_id(run))
    print(f"recording: {recording}", file=sys.stderr)
    arguments = ["--run", run, "--output", str(recording), "--connect", connect]
    arguments += ["--max-loss", str(max_loss), "--lateness", str(lateness)]
    return become("fusion_center", [*arguments, "--start-timeout", str(start_timeout)])
