"""`crossfix hub`: the meeting point of all processes of a run."""

from __future__ import annotations

from crossfix.commands import Name, Timeout


def hub(
    *,
    listen: str | None = None,
    connect: list[str] | None = None,
    until_run_ends: Name | None = None,
    start_timeout: Timeout = 600.0,
) -> None:
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
        until_run_ends: name of a run to end with, as soon as all its processes have left.
        start_timeout: seconds to wait for the world of that run.
    """
    from schemas.bus.hub import DEFAULT_ENDPOINT, run_hub

    endpoint, strict = listen or DEFAULT_ENDPOINT, listen is not None
    if until_run_ends is None:
        run_hub(endpoint, connect or (), strict)
        return
    from crossfix.end_of_run import EndOfRun

    end = EndOfRun(until_run_ends, start_timeout)
    run_hub(endpoint, connect or (), strict, ready=end.follow)
    if end.error:
        raise end.error
