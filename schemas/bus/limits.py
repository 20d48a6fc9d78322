"""What one sample may weigh, on every bus alike."""

from __future__ import annotations

from ..codec import MAX_PAYLOAD_BYTES
from ..errors import WireError

OVERHEAD_BYTES = 256
"""Of an item in an inbox beside its key and payload, so that empty samples are bounded too."""


def weigh(key: str, payload: bytes = b"") -> int:
    """Bytes that a sample or a token takes in an inbox."""
    return len(key) + len(payload) + OVERHEAD_BYTES


def require_size(key: str, payload: bytes) -> None:
    """Refuse what the hub would let vanish without a word.

    Raises:
        WireError: the payload is too large.
    """
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise WireError(
            "payload too large for the bus",
            where=key,
            got=len(payload),
            expected=f"<= {MAX_PAYLOAD_BYTES} bytes",
        )
