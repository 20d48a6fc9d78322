"""Bytes over real sockets, pipes and files; connections that die."""

from __future__ import annotations

import os
import socket
import struct
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from carriers.bridges import feeds
from carriers.bridges.feeds import (
    Arrival,
    Connection,
    Connections,
    Datagrams,
    Feed,
    Pipe,
    endpoint,
)
from schemas.errors import CrossfixError

HOST = "127.0.0.1"
DEADLINE_S = 10.0


def until(feed: Feed, done: Callable[[list[Arrival]], bool]) -> list[Arrival]:
    """Everything that comes until it is enough."""
    arrivals: list[Arrival] = []
    deadline_s = time.monotonic() + DEADLINE_S
    while not done(arrivals):
        assert time.monotonic() < deadline_s, arrivals
        arrivals += feed.take(0.05)
    return arrivals


def has(data: bytes) -> Callable[[list[Arrival]], bool]:
    return lambda arrivals: b"".join(a.data for a in arrivals).endswith(data)


def break_off(connection: socket.socket) -> None:
    """End a connection as a machine that crashes does: with a reset."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    connection.close()


def test_datagrams_arrive_whole_and_apart() -> None:
    with closing(Datagrams(HOST, 0)) as feed, socket.socket(type=socket.SOCK_DGRAM) as sender:
        for data in (b"one", b"two\n"):
            sender.sendto(data, (HOST, feed.port))
        arrivals = until(feed, lambda found: len(found) == 2)
    assert arrivals == [Arrival(0, b"one", whole=True), Arrival(0, b"two\n", whole=True)]


def test_a_connection_that_dies_ends_alone() -> None:
    with (
        closing(Connections(HOST, 0)) as feed,
        socket.create_connection((HOST, feed.port)) as first,
    ):
        second = socket.create_connection((HOST, feed.port))
        first.sendall(b"a")
        second.sendall(b"b")
        arrivals = until(feed, lambda found: len(found) == 2)
        numbers = {a.data: a.origin for a in arrivals}
        break_off(second)
        ended = until(feed, lambda found: any(a.ended for a in found))
        assert [a.origin for a in ended] == [numbers[b"b"]]
        first.sendall(b"more")
        assert until(feed, has(b"more"))[-1].origin == numbers[b"a"]


def test_connections_without_end_are_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feeds, "MAX_CONNECTIONS", 1)
    with (
        closing(Connections(HOST, 0)) as feed,
        socket.create_connection((HOST, feed.port)) as first,
        socket.create_connection((HOST, feed.port)) as second,
    ):
        first.sendall(b"still here")
        until(feed, has(b"still here"))
        second.settimeout(DEADLINE_S)
        while feed.take(0.01):
            continue
        assert second.recv(1) == b""


def test_a_server_that_dies_is_connected_to_again() -> None:
    with socket.create_server((HOST, 0)) as server:
        address = server.getsockname()
        with closing(Connection(*address)) as feed:
            assert feed.take(0.1) == []
            peer, _ = server.accept()
            peer.sendall(b"half a li")
            assert until(feed, has(b"li"))[-1].origin == 1
            server.close()
            break_off(peer)
            assert until(feed, bool) == [Arrival(1, b"", ended=True)]
            assert feed.take(0.05) == []  # nobody is there now
            with socket.create_server(address) as again:
                again.settimeout(0.05)
                peer = _accepted(again, feed)
                with peer:
                    peer.sendall(b"new")
                    assert until(feed, has(b"new"))[-1].origin == 2


def _accepted(server: socket.socket, feed: Feed) -> socket.socket:
    deadline_s = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline_s:
        assert feed.take(0.05) == []
        try:
            return server.accept()[0]
        except TimeoutError:
            continue
    raise AssertionError("it never came back")


def test_a_file_is_read_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "plots.jsonl"
    path.write_bytes(b"x" * 200_000)
    with closing(Pipe(str(path))) as feed:
        arrivals = until(feed, lambda found: feed.ended)
        assert b"".join(a.data for a in arrivals) == b"x" * 200_000
        assert arrivals[-1] == Arrival(0, b"", ended=True)
        assert feed.take(0.0) == []


def test_standard_input_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    with os.fdopen(reading) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with closing(Pipe()) as feed:
            assert feed.take(0.01) == []
            os.write(writing, b"line\n")
            assert feed.take(1.0) == [Arrival(0, b"line\n")]
            os.close(writing)
            until(feed, lambda found: feed.ended)


@pytest.mark.parametrize("text", ["", "host", "host:", ":80", "host:http", "host:70000"])
def test_what_is_no_address_is_said(text: str) -> None:
    with pytest.raises(CrossfixError, match="HOST:PORT"):
        endpoint(text)


def test_addresses() -> None:
    assert endpoint("127.0.0.1:8600") == ("127.0.0.1", 8600)
    assert endpoint("[::1]:1") == ("::1", 1)


def test_a_taken_port_and_a_missing_file_are_said(tmp_path: Path) -> None:
    with (
        closing(Datagrams(HOST, 0)) as feed,
        pytest.raises(CrossfixError, match=r"cannot listen.*free port"),
    ):
        Datagrams(HOST, feed.port)
    with pytest.raises(CrossfixError, match="No such file"):
        Pipe(str(tmp_path / "none"))
