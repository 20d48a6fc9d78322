"""Hears what is published and keeps nothing: what listening costs, before anything is recorded."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager

from fusion_center.recorder.thread import GATHER_S
from schemas import keys
from schemas.bus.interface import Inbox, Sample
from schemas.bus.zenoh_bus import open_bus
from schemas.bus.zenoh_session import open_session

from .publisher import say
from .samples import RUN


def main(endpoint: str, kind: str) -> None:
    """Listen until a line comes."""
    with LISTENING[kind](endpoint):
        say("ready")
        sys.stdin.readline()


@contextmanager
def plain(endpoint: str) -> Iterator[None]:
    """The least there is from Python: a callback of Zenoh's that counts."""
    heard = [0]

    def count(sample: object) -> None:
        del sample
        heard[0] += 1

    with open_session({"mode": "client", "connect/endpoints": [endpoint]}) as session:
        subscriber = session.declare_subscriber(keys.everything(RUN), count)
        yield
        subscriber.undeclare()  # type: ignore[no-untyped-call]


@contextmanager
def ours(endpoint: str, gather_s: float = 0.0) -> Iterator[None]:
    """Our bus and a thread that takes what has come."""
    inbox: Inbox[Sample] = Inbox(gather_s=gather_s)
    over = threading.Event()
    thread = threading.Thread(target=drain, args=(inbox, over))
    thread.start()
    with open_bus(endpoint) as bus:
        bus.subscribe(keys.everything(RUN), inbox)
        yield
    over.set()
    thread.join()


def drain(inbox: Inbox[Sample], over: threading.Event) -> None:
    """Take what comes, until it is over."""
    while not over.is_set():
        inbox.take(0.05)


LISTENING: Mapping[str, Callable[[str], AbstractContextManager[None]]] = {
    "plain": plain,
    "ours": ours,
    "gathering": lambda endpoint: ours(endpoint, GATHER_S),
}

if __name__ == "__main__":
    main(*sys.argv[1:])
