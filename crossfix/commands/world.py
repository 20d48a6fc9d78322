"""`crossfix world`: the world of a run, started by hand."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from crossfix.commands import ENDPOINT, HUB_TIMEOUT, Name, Rate, Timeout


@Parameter(name="*")
@dataclass(frozen=True)
class WorldWaits:
    """How long the world waits, and for whom.

    Attributes:
        start_timeout: seconds to wait for the hub and for all processes to be ready.
        step_timeout: seconds after which a carrier that does not answer is given up.
        hub_timeout: seconds that the hub may be away before this ends.
    """

    start_timeout: Timeout = 600.0
    step_timeout: Timeout = 10.0
    hub_timeout: Timeout = HUB_TIMEOUT


WAITS = WorldWaits()


def world(
    scenario: Path,
    /,
    *,
    connect: str = ENDPOINT,
    run: Name | None = None,
    rate: Rate = "max",
    overrides: Annotated[tuple[str, ...], Parameter(name="--set", negative=())] = (),
    data: Path | None = None,
    waits: WorldWaits = WAITS,
) -> int:
    """Publish the truth of a scenario and grant its steps, once everybody is there.

    `crossfix run` does this and everything else on one machine. To spread a run over several,
    start a hub, then this, every carrier and the fusion centre with the same --connect.

    ```
    crossfix world scenarios/strait.toml --connect tcp/192.0.2.7:7447
    ```

    Args:
        scenario: TOML file.
        connect: endpoint of the hub.
        run: name of the run, by default the scenario's.
        rate: `max` for lock-step, or a multiple of real time.
        overrides: a scenario key and its value, such as `seed=7`.
        data: folder of the recorded tracks that a scenario names (or set CROSSFIX_DATA).
        waits: how long for whom.
    """
    from crossfix.launch import become

    arguments = [str(scenario), "--connect", connect, "--rate", rate]
    arguments += [
        "--start-timeout",
        str(waits.start_timeout),
        "--step-timeout",
        str(waits.step_timeout),
    ]
    arguments += ["--hub-timeout", str(waits.hub_timeout)]
    arguments += ["--run", run] if run else []
    arguments += ["--data", str(data)] if data else []
    for override in overrides:
        arguments += ["--set", override]
    return become("sim_world", arguments)
