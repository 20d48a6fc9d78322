"""A sample understood: what its key says, what its payload says, and that they say the same."""

from __future__ import annotations

from functools import lru_cache
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

    An access rule acts on keys: it is worth nothing if the envelope may speak for somebody else.

    Raises:
        WireError: no key of ours, not decodable, a reserved name, or key and envelope disagree.
    """
    place = _place(sample.key)
    message = codec.decode(place.address.topic.message, sample.payload, sample.encoding)
    said = place.said(message)
    if said != place.meant:
        raise WireError(
            "key and envelope disagree",
            where=sample.key,
            got="/".join(said),
            expected="/".join(place.meant),
        )
    return Received(place.address, message)


class _Place(NamedTuple):
    """A key, and what the envelope of a message on it has to say."""

    address: keys.Address
    fields: tuple[str, ...]
    meant: tuple[str, ...]

    def said(self, message: Struct) -> tuple[str, ...]:
        """What a message says in those fields; one it has not cannot disagree."""
        pairs = zip(self.fields, self.meant, strict=True)
        return tuple([getattr(message, field, id_) for field, id_ in pairs])


@lru_cache(maxsize=4096)  # a run has some dozens of keys; strangers' may be anything
def _place(key: str) -> _Place:
    address = keys.parse(key)
    if address.topic.role is keys.Role.INPUT:
        _require_free_names(address)
    meant = dict(address.ids)
    if issubclass(address.topic.message, Input):
        meant["stream"] = keys.stream(address)
    return _Place(address, tuple(meant), tuple(meant.values()))


def _require_free_names(address: keys.Address) -> None:
    """No carrier is called as a process of the run, no source as a stream of its own."""
    carrier, source = address.ids.get("carrier"), address.ids.get("source")
    if carrier in keys.RESERVED_PROCESSES:
        raise WireError("no carrier may be called so", got=carrier)
    if source in keys.RESERVED_STREAMS:
        raise WireError("no source may be called so", got=source)
