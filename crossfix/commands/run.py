"""`crossfix run`: world, carriers and fusion centre as processes, and what the corrections did."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from crossfix.commands import FILES, HUB_TIMEOUT, FileOptions, Name, Rate, Seconds, Timeout


@Parameter(name="*")
@dataclass(frozen=True)
class RunOptions:
    """How a scenario is run.

    Attributes:
        rate: `max` runs in lock-step, as fast as the machine can; a number is a multiple of real
            time, paced by the wall clock.
        output: recording to write; by default a new file in `recordings/`, never an old one.
        seed: of everything random, instead of the scenario's.
        overrides: a scenario key and its value, such as `fusion.association.gate=12`.
        name: of the run on the wire, by default the scenario's.
        connect: hub that runs already, such as tcp/192.0.2.7:7447; by default one is started.
        data: folder of the recorded tracks that a scenario names (or set CROSSFIX_DATA).
        start_timeout: seconds to wait for all processes to be ready.
        step_timeout: seconds after which a carrier that does not answer is given up.
        hub_timeout: seconds that the hub may be away; then every process ends, with what is
            recorded by then.
        max_loss: seconds of recording that a crash may cost.
        delay: each carrier waits a random time up to this in each step; it changes no result.
        verify: fuse the recording again at the end and compare every byte of its outputs.
        report: draw the recording as a page beside it, as `crossfix report` does; needs bokeh.
        json: print the table as JSON on stdout.
        files: how the recording lies on the disk.
    """

    rate: Rate = "max"
    output: Annotated[Path | None, Parameter(alias="-o")] = None
    seed: int | None = None
    overrides: Annotated[tuple[str, ...], Parameter(name="--set", negative=())] = ()
    name: Name | None = None
    connect: str | None = None
    data: Path | None = None
    start_timeout: Timeout = 30.0
    step_timeout: Timeout = 10.0
    hub_timeout: Timeout = HUB_TIMEOUT
    max_loss: Seconds = 0.25
    delay: Seconds = 0.0
    verify: Annotated[bool, Parameter(negative=())] = False
    report: Annotated[bool, Parameter(negative=())] = False
    json: Annotated[bool, Parameter(negative=())] = False
    files: FileOptions = FILES


DEFAULTS = RunOptions()


def run(scenario: Path, /, *, options: RunOptions = DEFAULTS) -> int:
    """Run a scenario as processes that talk over Zenoh, and record it.

    Starts a hub, the world, every carrier and the fusion centre, shows how far they are, and ends
    with a table: the error of each carrier's frame before and after correction. Ctrl-C once ends
    the run cleanly, with a readable recording; twice kills it. The exit code is that of the first
    process that failed.

    ```
    crossfix run scenarios/strait.toml --seed 7 -o recordings/seven.mcap
    crossfix run scenarios/strait.toml --rate 20 --set errors.enabled=false
    ```

    Args:
        scenario: TOML file; those of the project are in `scenarios/`.
    """
    from crossfix.running import carry_out

    return carry_out(scenario, options)
