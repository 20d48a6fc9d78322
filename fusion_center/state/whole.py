"""Everything the fusion remembers from one Closed to the next: explicit, bounded, serialisable.

Nothing here is ever changed in place; a step makes a new `State` that shares what stayed.
`pack` and `unpack` lose no bit, so a run may be cut anywhere and taken up elsewhere.
"""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
from msgspec import Struct

from schemas.messages import DeclaredCarrier, DeclaredScenario, SourceProperties

from ..settings import Settings
from .carriers import CarrierState, Timeline
from .group import Group
from .links import Frames, Link, Orders, Strain
from .targets import Drawn, Line, Nameless, Paired, Rays


class Past(Struct, frozen=True, kw_only=True, eq=False):
    """One instant that has been fused, in case something older still comes.

    Attributes:
        before: the state until then, without a past; only some instants keep it.
        messages: names of their types, and payloads.
    """

    t_ns: int
    before: State | None
    messages: tuple[tuple[str, bytes], ...]


class State(Struct, frozen=True, kw_only=True):
    """The whole memory of the fusion.

    Attributes:
        own: the carrier whose frame is the gauge.
        window: sources that have reported since the last report event, carrier/source -> when.
        frames: of the carriers that are followed; None while there is none.
        strains: by carrier/source whose ranges are held against those of others.
        past: the last few seconds, oldest first, for what comes late.
        lines: by carrier/source/name of the target there.
        group: carriers that range to each other and to beacons; None while there is none.
        rays: by carrier/name of the target there, see `naming`; only while some carrier sees
            bearings only.
        crossed: what is told of targets of which several carriers have bearings, by their names.
        nameless: by carrier/source that sends bearings without names.
        paired: of targets that no name joins, by carrier/name of the target there.
        published: messages so far, by key.
    """

    centre: str
    own: str
    scenario: DeclaredScenario
    settings: Settings
    timeline: Timeline = Timeline()
    orders: Orders = Orders()
    carriers: dict[str, CarrierState] = {}
    links: dict[str, Link] = {}
    window: dict[str, int] = {}
    frames: Frames | None = None
    strains: dict[str, Strain] = {}
    picture: Drawn = Drawn()
    lines: dict[str, Line] = {}
    group: Group | None = None
    rays: dict[str, Rays] = {}
    crossed: dict[str, Line] = {}
    nameless: dict[str, Nameless] = {}
    paired: dict[str, Paired] = {}
    past: tuple[Past, ...] = ()
    published: dict[str, int] = {}

    def declared(self, carrier: str) -> DeclaredCarrier | None:
        """What the scenario says of a carrier beforehand."""
        return next((c for c in self.scenario.carriers if c.name == carrier), None)

    def sources(self, carrier: str) -> dict[str, SourceProperties]:
        """What is known of a carrier's sources; its own SourceInfo overrides the scenario."""
        declared = self.declared(carrier)
        known = self.carriers.get(carrier, CarrierState())
        return {**(declared.sources if declared else {}), **known.sources}


def pack(state: State) -> bytes:
    """The state as bytes."""
    return _ENCODER.encode(state)


def unpack(data: bytes) -> State:
    """The state that `pack` made into these bytes."""
    return _DECODER.decode(data)


def _from_array(value: Any) -> tuple[str, tuple[int, ...], bytes]:
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(f"no {type(value).__name__} in a state")
    return value.dtype.str, value.shape, np.ascontiguousarray(value).tobytes()


def _to_array(kind: Any, value: Any) -> Any:
    dtype, shape, data = value
    return np.frombuffer(data, dtype).reshape(shape).copy()  # aligned, as it was


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_from_array)
_DECODER = msgspec.msgpack.Decoder(State, dec_hook=_to_array)
