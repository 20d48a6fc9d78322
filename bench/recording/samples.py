"""Messages as carriers send them, of a size; the same for ours and for the references."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from schemas import codec, keys
from schemas.messages import SourceReport

RUN = "bench"
CARRIERS = 10
EPOCH_NS = 1_767_225_600 * 10**9
ENCODING = codec.encoding_of(SourceReport)
KEYS = [keys.REPORT.key(RUN, f"c{n}", "radar") for n in range(CARRIERS)]
SMALL_BYTES, LARGE_BYTES = 200, 2000


class Message(NamedTuple):
    """One message of a stream."""

    key: str
    payload: bytes
    t_ns: int
    seq: int


def payloads(seed: int, size: int, count: int, boot: str = "b") -> list[bytes]:
    """Reports of about `size` bytes, in the turn of the carriers, each with its seq."""
    rng = np.random.default_rng(seed)
    logs = max(1, (size - 80) // 27)
    bearings = rng.uniform(-3, 3, (64, logs)).tolist()
    ranges = rng.uniform(500, 30_000, (64, logs)).tolist()
    return [
        codec.encode(
            SourceReport(
                carrier=f"c{n % CARRIERS}",
                boot=boot,
                stream="radar",
                seq=n // CARRIERS + 1,
                t_ns=EPOCH_NS + n * 25_000,
                bearing_rad=bearings[n % 64],
                range_m=ranges[n % 64],
                sigma_range_m=ranges[(n + 1) % 64],
            )
        )
        for n in range(count)
    ]


def stream(data: list[bytes], count: int, hz: float = 40_000.0) -> list[Message]:
    """Messages of a rate, whose payloads repeat."""
    period_ns = round(1e9 / hz)
    return [
        Message(
            KEYS[n % CARRIERS], data[n % len(data)], EPOCH_NS + n * period_ns, n // CARRIERS + 1
        )
        for n in range(count)
    ]
