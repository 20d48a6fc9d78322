"""`crossfix carrier`: one simulated carrier of a run, started by hand."""

from __future__ import annotations

from crossfix.commands import ENDPOINT, HUB_TIMEOUT, Name, Timeout


def carrier(
    name: Name,
    /,
    *,
    run: Name,
    connect: str = ENDPOINT,
    start_timeout: Timeout = 600.0,
    hub_timeout: Timeout = HUB_TIMEOUT,
) -> int:
    """Simulate one carrier: its navigation and its sensors, as the scenario has them.

    It fetches the scenario from the world. A carrier that joins late, or comes back after it was
    lost, takes part from the next step on.

    ```
    crossfix carrier levante --run strait --connect tcp/192.0.2.7:7447
    ```

    Args:
        name: of the carrier in the scenario.
        run: name of the run.
        connect: endpoint of the hub.
        start_timeout: seconds to wait for the hub and the world.
        hub_timeout: seconds that the hub may be away before this ends.
    """
    from crossfix.launch import become

    arguments = [name, "--run", run, "--connect", connect, "--start-timeout", str(start_timeout)]
    arguments += ["--hub-timeout", str(hub_timeout)]
    return become("carriers", arguments)
