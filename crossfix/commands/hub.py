"""`crossfix hub`: the meeting point of all processes of a run."""

from __future__ import annotations

LISTEN = "tcp/127.0.0.1:7447"


def hub(*, listen: str = LISTEN) -> int:
    """Route messages between the processes of a run until Ctrl-C.

    `crossfix run` starts a hub of its own; this one is for processes that are started by hand, on
    one machine or on several. By default only this machine can reach it.

    ```
    crossfix hub --listen tcp/0.0.0.0:7447
    ```

    Args:
        listen: Zenoh endpoint to listen on; 0.0.0.0 opens it to the network.
    """
    from schemas.bus.hub import run_hub

    return run_hub(listen)
