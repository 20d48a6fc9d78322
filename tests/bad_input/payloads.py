"""Samples as nobody should send them: random bytes, and messages with something broken in them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from copy import deepcopy
from random import Random
from typing import Any

import msgpack

from schemas import codec, keys
from schemas import messages as m
from schemas.bus.interface import Sample

Map = dict[str, Any]
CARRIERS = ("alpha", "bravo", "mallory")
STRANGE = (
    None, True, False, 0, -1, 2**63 - 1, 2**63, 2**64 - 1, -(2**63), 1.5, -0.0, 1e308, 5e-324,
    math.nan, math.inf, -math.inf, "", "x", "x" * 2000, "\x00", "Ä", b"", b"\xff" * 9, [], [[]],
    [None], [math.nan], {}, {"a": {"b": {}}}, {1: 2}, [1] * 300, ["a", 1, None, 2.5],
)  # fmt: skip
"""Values that fit nowhere, or hardly."""


class Chaos:
    """Makes samples by chance, the same ones for the same seed.

    Args:
        run: whose keys they are put on, mostly.
        boots: lives that are spoken for; strangers', so that no true message is displaced.
    """

    def __init__(self, seed: int, run: str, boots: tuple[str, ...] = ("f00", "ba4")) -> None:
        self._dice = Random(seed)
        self._run, self._boots = run, boots
        self._kinds: tuple[Callable[[], Sample], ...] = (
            self._random_bytes,
            self._random_bytes,
            self._mutated_bytes,
            self._mutated_bytes,
            self._mutated_fields,
            self._mutated_fields,
            self._mutated_json,
            self._truncated,
            self._misplaced,
            self._bad_key,
            self._repeated,
        )
        self._last = self._whole()

    def samples(self, count: int) -> Iterator[Sample]:
        """So many of them."""
        for _ in range(count):
            yield self._dice.choice(self._kinds)()

    def _whole(self) -> Sample:
        """A message that is nearly all right."""
        dice = self._dice
        topic, ids, message = dice.choice(_WHOLE)(dice, dice.choice(CARRIERS), self._boot())
        kind = topic.message
        return Sample(topic.key(self._run, *ids), msgpack.packb(message), codec.encoding_of(kind))

    def _boot(self) -> str:
        dice = self._dice
        return dice.choice(self._boots) if dice.random() < 0.7 else f"{dice.getrandbits(32):x}"

    def _random_bytes(self) -> Sample:
        size = self._dice.choice((0, 1, 5, 40, 400))
        return self._whole()._replace(payload=self._dice.randbytes(size))

    def _mutated_bytes(self) -> Sample:
        sample = self._whole()
        payload = bytearray(sample.payload)
        for _ in range(self._dice.randint(1, 8)):
            payload[self._dice.randrange(len(payload))] = self._dice.randrange(256)
        return sample._replace(payload=bytes(payload))

    def _mutated_fields(self) -> Sample:
        sample = self._whole()
        return sample._replace(payload=msgpack.packb(self._spoiled(sample)))

    def _mutated_json(self) -> Sample:
        sample = self._whole()
        text = json.dumps(self._spoiled(sample), default=repr).encode()
        encoding = sample.encoding.replace("msgpack", "json")
        return sample._replace(payload=text, encoding=encoding)

    def _spoiled(self, sample: Sample) -> Map:
        """The message with one to three values replaced, removed, added or moved."""
        message: Map = msgpack.unpackb(sample.payload)
        for _ in range(self._dice.randint(1, 3)):
            place: Any = message
            while (inner := self._inner(place)) and self._dice.random() < 0.5:
                place = inner
            self._spoil(place)
        return message

    def _inner(self, place: Any) -> Any:
        values = list(place.values()) if isinstance(place, dict) else list(place)
        deeper = [value for value in values if isinstance(value, dict | list) and value]
        return self._dice.choice(deeper) if deeper else None

    def _spoil(self, place: Any) -> None:
        names = list(place) if isinstance(place, dict) else list(range(len(place)))
        if not names:
            return
        name, strange = self._dice.choice(names), deepcopy(self._dice.choice(STRANGE))
        if isinstance(place, dict) and self._dice.random() < 0.2:
            place[self._dice.choice(("seq", "t_ns", "boot", "new", ""))] = strange
        elif self._dice.random() < 0.2:
            del place[name]
        else:
            place[name] = strange

    def _truncated(self) -> Sample:
        sample = self._whole()
        return sample._replace(payload=sample.payload[: self._dice.randrange(len(sample.payload))])

    def _misplaced(self) -> Sample:
        """A whole message on the key of another."""
        return self._whole()._replace(key=self._whole().key)

    def _bad_key(self) -> Sample:
        sample, dice = self._whole(), self._dice
        chunks = sample.key.split("/")
        place = dice.randrange(3, len(chunks))
        chunks[place] = dice.choice(("*", "**", "UPPER", "a" * 70, "x y", "ä", "nothing", "world"))
        return sample._replace(key="/".join(chunks[: dice.randint(3, len(chunks))]))

    def _repeated(self) -> Sample:
        """The same once more, or another under the same number."""
        if self._dice.random() < 0.3:
            self._last = self._whole()
        return self._last


def _envelope(dice: Random, carrier: str, boot: str, stream: str) -> Map:
    seq = dice.choice((1, 2, dice.randint(1, 50), 2**31, 2**62))
    t_ns = dice.choice((0, 1, 1_767_225_600 * 10**9 + dice.randrange(10**11), 2**62))
    step = dice.choice((0, 0, dice.randint(0, 60), 2**62))
    return {"carrier": carrier, "boot": boot, "stream": stream, "seq": seq, "t_ns": t_ns,
            "step": step}  # fmt: skip


def _report(dice: Random, carrier: str, boot: str) -> tuple[keys.Topic, tuple[str, ...], Map]:
    source = dice.choice(("radar", "ais", f"s{dice.randrange(10**6)}"))
    n = dice.randrange(4)
    logs = {
        "bearing_rad": [dice.uniform(0, 7) for _ in range(n)],
        "range_m": [dice.uniform(-10, 1e4) for _ in range(n)],
        "sigma_range_m": [dice.choice((30.0, 0.0, -1.0)) for _ in range(n)],
        "covariance_polar": [[1.0, dice.choice((0.0, 5.0)), 1.0] for _ in range(n)],
        "identity": ["t"] * n,
        "features": {"length": {"values": [1.0] * n}},
    }
    return keys.REPORT, (carrier, source), {**_envelope(dice, carrier, boot, source), **logs}


def _navigation(dice: Random, carrier: str, boot: str) -> tuple[keys.Topic, tuple[str, ...], Map]:
    pose = {"latitude_rad": dice.uniform(-2, 2), "longitude_rad": 0.1,
            "covariance": [1.0, 0, 0, 1.0, 0, dice.choice((1.0, -1.0))]}  # fmt: skip
    message = {**_envelope(dice, carrier, boot, "navigation"), "pose": pose}
    return keys.NAVIGATION, (carrier,), message


def _source(dice: Random, carrier: str, boot: str) -> tuple[keys.Topic, tuple[str, ...], Map]:
    properties = {"period_s": dice.choice((1.0, 0.0, math.inf)), "kind": "radar"}
    message = {**_envelope(dice, carrier, boot, "info"), "source": "radar",
               "properties": properties}  # fmt: skip
    return keys.SOURCE, (carrier, "radar"), message


def _step(dice: Random, carrier: str, boot: str) -> tuple[keys.Topic, tuple[str, ...], Map]:
    step = dice.choice((1, dice.randint(1, 60), 2**62))
    message: Map = {"boot": boot, "step": step, "t_ns": dice.choice((0, step, 2**62))}
    extra: Map = {"ended": "by me"} if dice.random() < 0.3 else {"mode": "paced"}
    return keys.STEP, (), {**message, **extra}


def _closed(dice: Random, carrier: str, boot: str) -> tuple[keys.Topic, tuple[str, ...], Map]:
    end = {"carrier": carrier, "boot": boot, "stream": "radar", "last_seq": 2**62}
    step = dice.choice((1, dice.randint(1, 60), 2**62))
    message = {"step": step, "t_ns": dice.randrange(2**62), "manifest": [end], "lost": ["alpha"]}
    return keys.CLOSED_WORLD, (), message


def _ack(dice: Random, carrier: str, boot: str) -> tuple[keys.Topic, tuple[str, ...], Map]:
    who = dice.choice((carrier, "fusion", "alpha"))
    end = {"carrier": "bravo", "boot": boot, "stream": "radar", "last_seq": 2**62}
    message = {"process": who, "boot": boot, "step": dice.choice((0, 5, 2**62)), "manifest": [end]}
    return keys.ACK, (dice.choice((who, "mallory")),), message


def _output(dice: Random, carrier: str, boot: str) -> tuple[keys.Topic, tuple[str, ...], Map]:
    message = {"centre": "mallory", "seq": dice.randint(1, 99), "step": 1, "t_ns": 1}
    return keys.QUALITY, ("mallory",), message


def _state(dice: Random, carrier: str, boot: str) -> tuple[keys.Topic, tuple[str, ...], Map]:
    message = {"process": carrier, "boot": boot, "t_ns": 1, "counters": {"a": 2**62}}
    return keys.STATE, (carrier,), message


_WHOLE = (_report, _report, _report, _navigation, _source, _step, _closed, _ack, _output, _state)
INPUTS = {m.SourceReport, m.Navigation, m.SourceInfo, m.Ranging}
