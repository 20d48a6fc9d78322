"""The hub every process of a run connects to: a Zenoh router that does nothing else.

    python -m schemas.bus.hub --listen tcp/127.0.0.1:7447

No Python of ours runs in it while it routes, so it survives what kills the others. `zenohd` with an
explicit listen endpoint serves as well.
"""

from __future__ import annotations

import argparse
import json
import re
import signal
import sys
from collections.abc import Callable, Sequence

import zenoh

from ..errors import BusError, CrossfixError
from .entry import leave_with_launcher
from .zenoh_session import Settings, close_session, open_session

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
ADVICE = "tcp/ADDRESS:PORT of this machine, such as tcp/127.0.0.1:7447 or tcp/0.0.0.0:7447"
CLOSE_S = 0.3
RECEIVERS = 64
"""Of a whole host that is cut off each link holds one for 10 s; idle they cost nothing."""
_SIGNALS = (signal.SIGINT, signal.SIGTERM)

_HUB: Settings = {
    "mode": "router",
    "scouting/delay": 0,
    "adminspace/enabled": True,  # tells which port was taken
    # One process that does not read holds up the others for this long, then loses its link.
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 150_000,  # us
    # 100 idle connections would shut everyone out for 10 s.
    "transport/unicast/accept_pending": 1000,
    "transport/unicast/accept_timeout": 3000,  # ms
    "transport/unicast/open_timeout": 3000,  # ms
}


def tell(endpoint: str) -> None:
    """Print where the hub listens."""
    sys.stdout.write(f"listening on {endpoint}\n")
    sys.stdout.flush()


def run_hub(
    listen: str = DEFAULT_ENDPOINT,
    connect: Sequence[str] = (),
    strict: bool = True,
    ready: Callable[[str], None] = tell,
) -> None:
    """Route until SIGTERM or SIGINT; prints `listening on tcp/127.0.0.1:PORT` when ready.

    Call it in the main thread.

    Args:
        listen: endpoint; port 0 takes a free one.
        connect: hubs to join, so that their processes and ours see each other.
        strict: a taken port is an error; otherwise a free one is used instead.
        ready: called with the endpoint; threads it starts leave the signals to the hub.

    Raises:
        BusError: cannot listen there; says what to do.
    """
    # Blocked before Zenoh starts its threads, so that they wait for sigwait whoever they reach.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    try:
        session, endpoint = _open(listen, connect, strict)
        ready(endpoint)
        signal.sigwait(_SIGNALS)
        close_session(session, CLOSE_S)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def main() -> int:
    """`python -m schemas.bus.hub`; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m schemas.bus.hub", description=__doc__)
    parser.add_argument(
        "--listen",
        metavar="ENDPOINT",
        help=f"default {DEFAULT_ENDPOINT}, or a free port when that one is taken",
    )
    parser.add_argument(
        "--connect", metavar="ENDPOINT", action="append", default=[], help="another hub to join"
    )
    options = parser.parse_args()
    leave_with_launcher()
    listen = options.listen or DEFAULT_ENDPOINT
    try:
        run_hub(listen, options.connect, strict=options.listen is not None)
    except CrossfixError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    return 0


def _open(listen: str, connect: Sequence[str], strict: bool) -> tuple[zenoh.Session, str]:
    """The hub's session, and the endpoint it listens on."""
    try:
        session = open_session(
            {**_HUB, "listen/endpoints": [listen], "connect/endpoints": list(connect)}, RECEIVERS
        )
    except zenoh.ZError as error:
        if "Address already in use" not in str(error):
            raise BusError(
                "cannot listen there", where=listen, got=_reason(error), expected=ADVICE
            ) from None
        if strict:
            raise BusError(
                f"{listen} is taken; end the hub that runs there, or pass --listen with another "
                "port (0 takes a free one)"
            ) from None
        return _open(_with_port(listen, 0), connect, strict=True)
    return session, _given(session, listen)


def _reason(error: zenoh.ZError) -> str:
    """The system's own words; Zenoh's go through its sources."""
    found = re.search(r": ([\w ,'-]+) \(os error \d+\)", str(error))
    return found[1] if found else "not an endpoint of this machine"


def _given(session: zenoh.Session, listen: str) -> str:
    """The endpoint with the port the hub was given for a 0."""
    if not listen.endswith(":0"):
        return listen
    for reply in session.get(f"@/{session.zid()}/router"):
        if reply.ok is not None:
            for locator in json.loads(reply.ok.payload.to_bytes())["locators"]:
                return _with_port(listen, int(locator.rpartition(":")[2]))
    raise BusError("the hub cannot tell its port", where=listen, expected="a port other than 0")


def _with_port(endpoint: str, port: int) -> str:
    return f"{endpoint.rpartition(':')[0]}:{port}"


if __name__ == "__main__":
    sys.exit(main())
