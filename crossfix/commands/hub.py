"""`crossfix hub`: the meeting point of all processes of a run."""

from __future__ import annotations


def hub(*, listen: str | None = None, connect: list[str] | None = None) -> None:
    """Route messages between the processes of a run until Ctrl-C.

    `crossfix run` starts a hub of its own; this one is for processes that are started by hand, on
    one machine or on several. By default only this machine can reach it.

    ```
    crossfix hub --listen tcp/0.0.0.0:7447
    ```

    Args:
        listen: Zenoh endpoint to listen on; 0.0.0.0 opens it to the network. By default
            tcp/127.0.0.1:7447, or a free port where that is taken; the hub prints which.
        connect: another hub to join, so that the processes of both see each other.
    """
    from schemas.bus.hub import DEFAULT_ENDPOINT, run_hub

    run_hub(listen or DEFAULT_ENDPOINT, connect or (), strict=listen is not None)
