"""A sample understood: what its key says, what its payload says, and that they say the same."""

from __future__ import annotations

from typing import NamedTuple

from msgspec import Struct

from . import codec, keys
from .bus.interface import Sample
from .errors import WireError
from .messages import Input


class Received(NamedTuple):
    """A sample that is what its key says."""

    address: keys.Address
    message: Struct


def receive(sample: Sample) -> Received:
    """Understand a sample, trusting nothing in it.

    Raises:
        WireError: no key of ours, not decodable, a reserved name, or key and envelope disagree.
    """
    address = keys.parse(sample.key)
    return Received(address, receive_at(address, sample))


def receive_at(address: keys.Address, sample: Sample) -> Struct:
    """The message of a sample whose key is understood already.

    An access rule acts on keys: it is worth nothing if the envelope may speak for somebody else.

    Raises:
        WireError: as `receive`.
    """
    if address.topic.role is keys.Role.INPUT:
        _require_free_names(address)
    message = codec.decode(address.topic.message, sample.payload, sample.encoding)
    meant = dict(address.ids)
    if isinstance(message, Input):
        meant["stream"] = keys.stream(address)
    said = {name: getattr(message, name, id_) for name, id_ in meant.items()}
    if said != meant:
        raise WireError(
            "key and envelope disagree",
            where=sample.key,
            got="/".join(said.values()),
            expected="/".join(meant.values()),
        )
    return message


def _require_free_names(address: keys.Address) -> None:
    """No carrier is called as a process of the run, no source as a stream of its own."""
    carrier, source = address.ids.get("carrier"), address.ids.get("source")
    if carrier in keys.RESERVED_PROCESSES:
        raise WireError("no carrier may be called so", got=carrier)
    if source in keys.RESERVED_STREAMS:
        raise WireError("no source may be called so", got=source)
