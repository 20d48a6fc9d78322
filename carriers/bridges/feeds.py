"""Where the bytes of a bridge come from: datagrams, connections, a pipe or a file."""

from __future__ import annotations

import errno
import logging
import os
import select
import socket
import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import NamedTuple, Protocol

from schemas.errors import CrossfixError

log = logging.getLogger("bridge")

CHUNK_BYTES = 64 * 1024
BATCH = 256
"""Datagrams taken at once, so that a flood does not keep the bridge from its other duties."""
MAX_CONNECTIONS = 256
RECEIVE_BUFFER_BYTES = 8 * 1024 * 1024
RETRY_S = 0.5
CONNECT_S = 1.0


class Arrival(NamedTuple):
    """Bytes of a feed.

    Attributes:
        origin: which connection they came over; every new one has a new number.
        whole: a datagram: nothing of it continues in the next.
        ended: the connection is over; `data` is empty.
    """

    origin: int
    data: bytes
    whole: bool = False
    ended: bool = False


class Feed(Protocol):
    """Bytes as they come."""

    @property
    def ended(self) -> bool:
        """Whether nothing will come any more."""

    def take(self, timeout_s: float) -> list[Arrival]:
        """What has come; waits up to `timeout_s` for something."""

    def close(self) -> None:
        """Let go of sockets and files."""


class Datagrams:
    """UDP datagrams to an address of this machine.

    Raises:
        CrossfixError: the address is none of ours, or taken.
    """

    ended = False

    def __init__(self, host: str, port: int) -> None:
        self._socket = _bound(socket.SOCK_DGRAM, host, port)
        # What the kernel grants of it (net.core.rmem_max) bounds a burst that is not lost.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        self._socket.setblocking(False)

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._socket.getsockname()[1])

    def take(self, timeout_s: float) -> list[Arrival]:
        """Datagrams that have come."""
        arrivals: list[Arrival] = []
        if select.select([self._socket], [], [], timeout_s)[0]:
            with suppress(BlockingIOError):
                while len(arrivals) < BATCH:
                    arrivals.append(Arrival(0, self._socket.recv(CHUNK_BYTES), whole=True))
        return arrivals

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class Connections:
    """TCP connections that others open to us; more than `MAX_CONNECTIONS` at once are closed.

    Raises:
        CrossfixError: the address is none of ours, or taken.
    """

    ended = False

    def __init__(self, host: str, port: int) -> None:
        self._listening = _bound(socket.SOCK_STREAM, host, port)
        self._listening.listen()
        self._open: dict[socket.socket, int] = {}
        self._number = 0

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._listening.getsockname()[1])

    def take(self, timeout_s: float) -> list[Arrival]:
        """What has come over any connection, and the ends of connections."""
        ready, _, _ = select.select([self._listening, *self._open], [], [], timeout_s)
        if self._listening in ready:
            ready.remove(self._listening)
            self._accept()
        arrivals = [_received(connection, self._open[connection]) for connection in ready]
        for connection, arrival in zip(ready, arrivals, strict=True):
            if arrival.ended:
                del self._open[connection]
                connection.close()
        return arrivals

    def _accept(self) -> None:
        connection, _ = self._listening.accept()
        if len(self._open) >= MAX_CONNECTIONS:
            connection.close()
            return
        self._number += 1
        self._open[connection] = self._number

    def close(self) -> None:
        """Close all connections."""
        for connection in [self._listening, *self._open]:
            connection.close()


class Connection:
    """One TCP connection that we open, and open again whenever it dies; says when it cannot."""

    ended = False

    def __init__(self, host: str, port: int) -> None:
        self._address = (host, port)
        self._socket: socket.socket | None = None
        self._number = 0
        self._retry_s = 0.0
        self._told = ""

    def take(self, timeout_s: float) -> list[Arrival]:
        """What has come, or the end of a connection."""
        if self._socket is None and not self._connect(timeout_s):
            return []
        assert self._socket is not None  # noqa: S101 (just connected)
        if not select.select([self._socket], [], [], timeout_s)[0]:
            return []
        arrival = _received(self._socket, self._number)
        if arrival.ended:
            self.close()
        return [arrival]

    def close(self) -> None:
        """Close the connection; the next `take` opens another."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _connect(self, timeout_s: float) -> bool:
        wait_s = self._retry_s - time.monotonic()
        if wait_s > 0:
            time.sleep(min(wait_s, timeout_s))
            return False
        self._retry_s = time.monotonic() + RETRY_S
        try:
            self._socket = socket.create_connection(self._address, timeout=CONNECT_S)
        except OSError as error:
            self._tell(f"{error.strerror or error}; trying again until it can be connected to")
            return False
        # A peer whose machine has vanished never says so.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._number += 1
        self._tell("connected")
        return True

    def _tell(self, news: str) -> None:
        if news != self._told:
            log.info("%s:%d: %s", *self._address, news)
            self._told = news


class Pipe:
    """Standard input, or a file, to its end.

    Raises:
        CrossfixError: no such file.
    """

    def __init__(self, path: str = "-") -> None:
        self.ended = False
        self._own = path != "-"
        try:
            self._fd = _opened(Path(path)) if self._own else sys.stdin.fileno()
        except OSError as error:
            raise CrossfixError(
                error.strerror or "cannot be read", where=path, expected="a file, or - for stdin"
            ) from None

    def take(self, timeout_s: float) -> list[Arrival]:
        """The next piece."""
        if self.ended or not select.select([self._fd], [], [], timeout_s)[0]:
            return []
        data = os.read(self._fd, CHUNK_BYTES)
        self.ended = not data
        return [Arrival(0, data, ended=self.ended)]

    def close(self) -> None:
        """Close the file."""
        if self._own:
            os.close(self._fd)


def endpoint(text: str) -> tuple[str, int]:
    """Host and port of HOST:PORT.

    Raises:
        CrossfixError: it is none.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise CrossfixError("not an address", got=text, expected="HOST:PORT")
    return host.strip("[]"), int(port)


def _opened(path: Path) -> int:
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    return os.open(path, os.O_RDONLY)


def _bound(kind: socket.SocketKind, host: str, port: int) -> socket.socket:
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=kind)[0]
        with ExitStack() as until_bound:
            bound = until_bound.enter_context(socket.socket(family, kind))
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, kind == socket.SOCK_STREAM)
            bound.bind(address)
            until_bound.pop_all()
            return bound
    except OSError as error:
        raise CrossfixError(
            f"cannot listen: {error.strerror or error}",
            where=f"{host}:{port}",
            expected="a free port of this machine, such as 127.0.0.1:8600",
        ) from None


def _received(connection: socket.socket, number: int) -> Arrival:
    try:
        data = connection.recv(CHUNK_BYTES)
    except OSError:  # it died
        data = b""
    return Arrival(number, data, ended=not data)
