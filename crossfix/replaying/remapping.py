"""Other names for those who were recorded: in the key, and in the envelope that must agree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import msgspec

from schemas import codec
from schemas.errors import CrossfixError
from schemas.feedback import renamed_id
from schemas.keys import Address, require_id
from schemas.messages import SourceReport
from schemas.recording.reader import Recorded


class Renames(NamedTuple):
    """Carriers, and sources of carriers, by their recorded names.

    Attributes:
        carriers: old name -> new one; sources: old (carrier, source) -> new source.
    """

    carriers: Mapping[str, str] = {}
    sources: Mapping[tuple[str, str], str] = {}

    def ids(self, address: Address) -> tuple[Mapping[str, str], Mapping[str, str] | None]:
        """The ids of a key under the new names, and what to change in its envelopes."""
        old = address.ids
        new = dict(old)
        carrier = old.get("carrier", "")
        if carrier in self.carriers:
            new["carrier"] = self.carriers[carrier]
        if (carrier, old.get("source", "")) in self.sources:
            new["source"] = self.sources[carrier, old["source"]]
        changes = {name: text for name, text in new.items() if old[name] != text}
        if "source" in changes and address.topic.message is SourceReport:
            changes["stream"] = changes.pop("source")
        return new, changes or None

    def rewritten(self, message: Recorded, changes: Mapping[str, str]) -> bytes:
        """The payload of a message with its envelope changed.

        Raises:
            WireError: what was recorded is not valid.
        """
        said = message.decode()
        renamed = msgspec.structs.replace(said, **changes, **_correction_of(said, changes))
        if "json" in message.encoding:
            return codec.encode_json(renamed)
        return codec.encode(renamed)


NO_RENAMES = Renames()


def renames_of(rules: Iterable[str]) -> Renames:
    """From OLD=NEW for a carrier, CARRIER/OLD=CARRIER/NEW for one of its sources.

    Raises:
        CrossfixError: a rule that is none.
    """
    carriers: dict[str, str] = {}
    sources: dict[tuple[str, str], str] = {}
    for rule in rules:
        old, _, new = rule.partition("=")
        was, became = old.split("/"), new.split("/")
        for name in (*was, *became):
            require_id(name)
        if len(was) == len(became) == 1:
            carriers[old] = new
        elif len(was) == len(became) == 2 and was[0] == became[0]:
            sources[was[0], was[1]] = became[1]
        else:
            raise CrossfixError(
                "--remap", got=rule, expected="CARRIER=NAME or CARRIER/SOURCE=CARRIER/NAME"
            )
    return Renames(carriers, sources)


def _correction_of(said: msgspec.Struct, changes: Mapping[str, str]) -> Mapping[str, str]:
    """The name of the correction that a message holds, made out to the carrier's new name."""
    held = getattr(said, "correction_id", "")
    if not held or "carrier" not in changes:
        return {}
    return {"correction_id": renamed_id(held, changes["carrier"])}
