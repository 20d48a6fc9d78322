"""Real buses whose links a test can cut, and waiting with a deadline."""

import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

from schemas.bus.interface import Inbox
from schemas.bus.zenoh_bus import ZenohBus, open_bus

T = TypeVar("T")
DEADLINE_S = 60.0


def take(inbox: Inbox[T], count: int, deadline_s: float = DEADLINE_S) -> list[T]:
    """At least `count` items, as soon as they are there; fewer at the deadline."""
    taken: list[T] = []
    end_s = time.monotonic() + deadline_s
    while len(taken) < count and (left_s := end_s - time.monotonic()) > 0:
        taken += inbox.take(left_s)
    return taken


def eventually(holds: Callable[[], bool], deadline_s: float = DEADLINE_S) -> bool:
    """Whether something comes true before the deadline."""
    end_s = time.monotonic() + deadline_s
    while not holds():
        if time.monotonic() > end_s:
            return False
        time.sleep(0.002)
    return True


class TcpRelay:
    """Stands between one process and the hub, and can be cut."""

    def __init__(self, endpoint: str) -> None:
        host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
        self._target = (host, int(port))
        self._lock = threading.Lock()
        self._cut = False
        self._sockets: list[socket.socket] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._listener.getsockname()[1]}"
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()

    def cut(self) -> None:
        """Break what is connected and accept nothing, until healed."""
        with self._lock:
            self._cut = True
            for connected in self._sockets:
                _shut(connected)

    def heal(self) -> None:
        """Accept connections again."""
        with self._lock:
            self._cut = False

    def close(self) -> None:
        """Cut for good."""
        self.cut()
        _shut(self._listener)
        for thread in self._threads:
            thread.join()
        self._listener.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._listener.accept()
                with self._lock:
                    if self._cut:
                        near.close()
                        continue
                    far = socket.create_connection(self._target)
                    self._join(near, far)

    def _join(self, near: socket.socket, far: socket.socket) -> None:
        self._sockets += [near, far]
        pair = threading.Thread(target=_carry_both, args=(near, far))
        pair.start()
        self._threads.append(pair)


def _carry_both(near: socket.socket, far: socket.socket) -> None:
    back = threading.Thread(target=_carry, args=(far, near))
    back.start()
    _carry(near, far)
    back.join()
    near.close()
    far.close()


def _carry(source: socket.socket, sink: socket.socket) -> None:
    sink.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    with suppress(OSError):
        while data := source.recv(65536):
            sink.sendall(data)
    _shut(source)
    _shut(sink)


def _shut(one: socket.socket) -> None:
    with suppress(OSError):
        one.shutdown(socket.SHUT_RDWR)


class ZenohNetwork:
    """As `MemoryNetwork`, of real sessions: each process has its own link to one hub."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._relays: dict[str, TcpRelay] = {}
        self._ended: list[TcpRelay] = []
        self._sessions: list[ZenohBus] = []

    def bus(self, name: str) -> ZenohBus:
        if name not in self._relays:
            self._relays[name] = TcpRelay(self._endpoint)
        self._sessions.append(open_bus(self._relays[name].endpoint))
        return self._sessions[-1]

    def cut(self, name: str) -> None:
        self._relays[name].cut()

    def heal(self, name: str) -> None:
        self._relays[name].heal()

    def kill(self, name: str) -> None:
        """To all others a killed process is a link that breaks: the kernel closes its sockets."""
        self._ended.append(self._relays.pop(name))
        self._ended[-1].cut()

    def close(self) -> None:
        for session in self._sessions:
            session.close()
        for relay in [*self._relays.values(), *self._ended]:
            relay.close()
