"""Decoders are made one at a time: msgspec is not safe while it learns a type."""

from __future__ import annotations

import threading
import time
from typing import Any

import msgspec
import pytest

from schemas import codec
from schemas.messages import Ack, Navigation, ProcessState, Ranging, SourceInfo, Step

THREADS_A_MESSAGE = 3


@pytest.mark.parametrize("encoding", ["application/msgpack", "application/json"])
def test_threads_that_meet_a_message_for_the_first_time_take_turns(
    encoding: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    inside: list[int] = []
    most: list[int] = []
    real = msgspec.msgpack.Decoder

    def slow(message: type[msgspec.Struct]) -> Any:
        inside.append(1)
        most.append(len(inside))
        time.sleep(0.002)  # what is being tested is whether anybody else comes in meanwhile
        inside.pop()
        return real(message)

    monkeypatch.setattr(msgspec.msgpack, "Decoder", slow)
    codec.reader.cache_clear()
    codec._decoder.cache_clear()
    kinds = [Ack, Navigation, ProcessState, Ranging, SourceInfo, Step] * THREADS_A_MESSAGE
    together = threading.Barrier(len(kinds))
    refused: list[str] = []

    def work(kind: type[msgspec.Struct]) -> None:
        together.wait()
        try:
            codec.decode(kind, b"{}" if "json" in encoding else b"\x80", encoding)
        except codec.WireError as error:
            refused.append(str(error))

    threads = [threading.Thread(target=work, args=(kind,)) for kind in kinds]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10)
    assert len(refused) == len(kinds)  # each lacks its first field
    assert len(most) >= len(set(kinds))
    assert max(most) == 1
