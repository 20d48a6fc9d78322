"""A publisher that does everything right, in plain maps, so that anything can be broken in it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from random import Random
from typing import Any, NamedTuple

import msgpack

from schemas import keys
from schemas.bus.interface import Sample

RUN = "trial"
CARRIER = "visitor"
BOOT = "b00t"
EPOCH_NS = 1_767_225_600 * 10**9
SECOND = 10**9
STEPS = 120
TARGETS = 12
SIGMA_RAD, SIGMA_M = 0.005, 30.0
RADAR: dict[str, Any] = {
    "kind": "radar",
    "coordinates": "bearing_range",
    "period_s": 1.0,
    "sigma_bearing_rad": SIGMA_RAD,
    "sigma_range_m": SIGMA_M,
    "range_max_m": 30_000.0,
}
Message = dict[str, Any]


class Sent(NamedTuple):
    """A message on its way: where it goes, what it is, what it says."""

    key: str
    kind: str
    message: Message


Break = Callable[[Sent], "list[Sent]"]
"""What a fault makes of one message: nothing, another, or several."""


def as_it_is(sent: Sent) -> list[Sent]:
    """No fault."""
    return [sent]


@dataclass
class Publisher:
    """A ship at anchor with a radar that sees ships pass.

    Args:
        broken: applied to each message before it is numbered.
        spoiled: applied to each numbered message.
    """

    broken: Break = as_it_is
    spoiled: Break = as_it_is
    first: int = 1
    steps: int = STEPS
    seed: int = 1
    noise: float = 1.0
    boot: str = BOOT
    _seq: dict[str, int] = field(default_factory=dict)

    def samples(self) -> Iterator[tuple[Sample, float]]:
        """Every sample with the time of its arrival."""
        for step in range(self.first, self.first + self.steps):
            for sent in self.step(step):
                yield as_sample(sent), (EPOCH_NS + step * SECOND) * 1e-9

    def step(self, step: int) -> Iterator[Sent]:
        """What it says in one second."""
        t_ns = EPOCH_NS + step * SECOND
        if step == self.first:
            yield from self._send("source/visitor/radar", "SourceInfo", "info", t_ns,
                                  {"source": "radar", "properties": RADAR})  # fmt: skip
        pose = {"latitude_rad": 0.63, "longitude_rad": -0.096,
                "covariance": [1e6, 0, 0, 1e6, 0, 3e-4]}  # fmt: skip
        fields = {"pose": pose, "kind": "fix"}
        yield from self._send("navigation/visitor", "Navigation", "navigation", t_ns, fields)
        logs = look(step, Random(f"{self.seed} {step}"), self.noise)
        yield from self._send("report/visitor/radar", "SourceReport", "radar", t_ns, logs)

    def _send(
        self, path: str, kind: str, stream: str, t_ns: int, fields: Message
    ) -> Iterator[Sent]:
        envelope = {"carrier": CARRIER, "boot": self.boot, "stream": stream, "t_ns": t_ns}
        whole = Sent(f"{keys.PREFIX}/{RUN}/{path}", kind, {**envelope, **fields})
        for sent in self.broken(whole):
            self._seq[stream] = self._seq.get(stream, 0) + 1
            numbered = {**sent.message, "seq": self._seq[stream]}
            yield from self.spoiled(sent._replace(message=numbered))


def look(step: int, dice: Random, noise: float) -> Message:
    """Target logs as columns; now and then there is nothing to see."""
    if step % 20 == 0:
        return {}
    logs: Message = {name: [] for name in (
        "bearing_rad", "range_m", "sigma_bearing_rad", "sigma_range_m", "track_id")}  # fmt: skip
    for target in range(TARGETS):
        east = -9000.0 + 1500.0 * target + 5.0 * step * math.cos(target)
        north = 4000.0 + 600.0 * target + 5.0 * step * math.sin(target)
        bearing = math.atan2(east, north) + dice.gauss(0, noise * SIGMA_RAD)
        logs["bearing_rad"].append(bearing % (2 * math.pi))
        logs["range_m"].append(math.hypot(east, north) + dice.gauss(0, noise * SIGMA_M))
        logs["sigma_bearing_rad"].append(SIGMA_RAD)
        logs["sigma_range_m"].append(SIGMA_M)
        logs["track_id"].append(f"t{target}")
    return logs


def as_sample(sent: Sent) -> Sample:
    """Packed as any program would."""
    payload = msgpack.packb(sent.message)
    return Sample(sent.key, payload, f"application/msgpack;crossfix.{sent.kind}")


def in_reports(change: Callable[[Message], Message]) -> Break:
    """A fault of the reports alone; those of nothing stay."""

    def broken(sent: Sent) -> list[Sent]:
        if sent.kind != "SourceReport" or "range_m" not in sent.message:
            return [sent]
        return [sent._replace(message=change(dict(sent.message)))]

    return broken


def without(kind: str) -> Break:
    """A kind of message that is never sent."""
    return lambda sent: [] if sent.kind == kind else [sent]
