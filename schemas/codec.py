"""Messages to bytes and back: MessagePack or JSON, strict, bounded in size."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

import msgspec

from .errors import WireError
from .json_integers import restorer
from .messages import Input

T = TypeVar("T", bound=msgspec.Struct)
MAX_PAYLOAD_BYTES = 8 * 1024 * 1024
MAX_INPUT_BYTES = 2 * 1024 * 1024
"""Of what a carrier says: anybody may send it, and decoding takes time and a multiple of memory."""
_MSGPACK = msgspec.msgpack.Encoder()
_ACQUAINTING = threading.Lock()


def encoding_of(message: type[msgspec.Struct], form: str = "msgpack") -> str:
    """Zenoh encoding of a message: `application/msgpack;crossfix.SourceReport`."""
    return f"application/{form};crossfix.{message.__name__}"


def encode(message: msgspec.Struct) -> bytes:
    """MessagePack map with named fields; defaults are left out.

    Raises:
        WireError: larger than the bus carries.
    """
    payload = _MSGPACK.encode(message)
    _require_size(type(message), payload)
    return payload


def encode_json(message: msgspec.Struct) -> bytes:
    """The same message as JSON."""
    return msgspec.json.encode(message)


def decode(message: type[T], payload: bytes, encoding: str = "") -> T:
    """Decode strictly: every type, bound, length and covariance is checked.

    Args:
        encoding: of the sample; what does not name JSON is taken for MessagePack. In JSON, 64-bit
            integers may be decimal strings.

    Raises:
        WireError: the field, what was got and what was expected.
    """
    return reader(message, "json" in encoding)(payload)  # type: ignore[no-any-return]


@cache
def reader(message: type[T], is_json: bool) -> Callable[[bytes], T]:
    """What `decode` reads one kind of message with; for who reads many of a kind."""
    most = most_bytes(message)
    decode: Callable[[bytes], Any] = _decoder(message).decode
    if is_json:
        decode = _json_decoder(message)

    def read(payload: bytes) -> T:
        if len(payload) > most:
            _require_size(message, payload)
        try:
            return decode(payload)  # type: ignore[no-any-return]
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError, OverflowError) as error:
            raise WireError(str(error), where=message.__name__) from None

    return read


def most_bytes(message: type[msgspec.Struct]) -> int:
    """What a message of this kind may have."""
    return MAX_INPUT_BYTES if issubclass(message, Input) else MAX_PAYLOAD_BYTES


def _require_size(message: type[msgspec.Struct], payload: bytes) -> None:
    most = most_bytes(message)
    if len(payload) > most:
        raise WireError(
            f"{message.__name__} too large", got=len(payload), expected=f"<= {most} bytes"
        )


def _json_decoder(message: type[T]) -> Callable[[bytes], T]:
    _decoder(message)  # acquainted under its lock
    restore = restorer(message)
    return lambda payload: msgspec.convert(restore(msgspec.json.decode(payload)), message)


@cache
def _decoder(message: type[msgspec.Struct]) -> msgspec.msgpack.Decoder[Any]:
    return acquainted(message)


def acquainted(message: type[msgspec.Struct]) -> msgspec.msgpack.Decoder[Any]:
    """A decoder of a type; nobody may make one in another way."""
    # While msgspec makes itself acquainted with a type, another thread that decodes to it crashes
    # the process (a NULL in the half-made description; seen with 0.22).
    with _ACQUAINTING:
        return msgspec.msgpack.Decoder(message)
