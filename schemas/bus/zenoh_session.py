"""Zenoh sessions as we want them: settings that differ from the defaults, a bounded close."""

from __future__ import annotations

import json
import logging
import os
import re
import threading
from collections.abc import Mapping

import zenoh

Settings = Mapping[str, object]
LEASE_MS = 2000
MAX_MESSAGE_BYTES = 16 * 1024 * 1024
RECEIVERS = 8
"""Zenoh closes a link that fell silent, as to a host that was cut off, for 10 s in one of its
receiving threads. It has two of them, and with both taken nothing else is received meanwhile."""
_LOG = logging.getLogger(__name__)

COMMON: Settings = {
    # Processes meet at the hub they were told of, and nowhere else.
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    # On by default; `put` panics where /dev/shm is small, as in a container.
    "transport/shared_memory/enabled": False,
    # A hung process is seen after this; one that dies, at once.
    "transport/link/tx/lease": LEASE_MS,
    "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES,
    # Half a second at most, so that all are back within a second of the hub.
    "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
}


def open_session(settings: Settings, receivers: int = RECEIVERS) -> zenoh.Session:
    """Open a session with the common settings and these.

    Args:
        receivers: threads, more than links that may fall silent at once; the first session of a
            process decides for all of them.

    Raises:
        zenoh.ZError: a setting does not exist, or there is nobody there.
    """
    os.environ["ZENOH_RUNTIME"] = f"(rx: (worker_threads: {receivers}))"
    config = zenoh.Config()
    for name, value in {**COMMON, **settings}.items():
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)


def in_words(error: zenoh.ZError) -> str:
    """What Zenoh says of an error, without where in its sources it says so."""
    return re.sub(r" at \S+\.rs:\d+\.?", "", str(error))


def close_session(session: zenoh.Session, timeout_s: float) -> None:
    """Close, but don't let a stuck link hold up the process (Zenoh itself waits 10 s for it)."""
    closing = threading.Thread(target=_close, args=(session,), name="bus close", daemon=True)
    closing.start()
    closing.join(timeout_s)


def _close(session: zenoh.Session) -> None:
    try:
        session.close()  # type: ignore[no-untyped-call]
    except BaseException as error:  # a panic in Rust is no Exception, and the run is over anyway
        _LOG.debug("session did not close well: %s", error)
