"""The truth of a simulation: for simulated carriers and the recorder, never for the fusion."""

from __future__ import annotations

from msgspec import Struct

from .values import Angle, Count, Id, Real, Seconds, Text, TimeNs

Vectors = list[list[Real]]


class TruthScenario(Struct, frozen=True, kw_only=True):
    """The truth part of a scenario: motions, actual errors, seed; the whole file as text."""

    name: Id
    seed: Count
    text: str


class TruthTargets(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """All targets that exist at one step, as columns, east-north-up at the scenario's origin.

    Between steps sensors extrapolate with velocity and acceleration.

    Attributes:
        number: stable number of a target, the key of its random draws; no index.
        position_m, velocity_mps, acceleration_mps2: (east, north, up) each.
        identity: name every carrier can see, or empty.
        features: name -> value of each target; words: name -> word of each, or empty.
    """

    boot: Id
    seq: Count
    step: Count
    t_ns: TimeNs
    number: list[int]
    position_m: Vectors
    velocity_mps: Vectors
    acceleration_mps2: Vectors
    classes: list[Text] = []
    identity: list[Text] = []
    features: dict[Id, list[Real]] = {}
    words: dict[Id, list[Text]] = {}


class TruthCarriers(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """All carriers at one step, as columns, east-north-up at the scenario's origin.

    Attributes:
        heading_rad: true heading of the bow.
        north_error_rad: bearing of the carrier's own north, clockwise from true north.
        clock_offset_s: the carrier's clock less true time.
        azimuth_bias_rad: what its first sensor adds to every bearing; empty = none adds anything.
        range_bias_m, range_scale: what it adds to every range, in metres and as a share of the
            range; empty = none adds anything.
    """

    boot: Id
    seq: Count
    step: Count
    t_ns: TimeNs
    carrier: list[Id]
    position_m: Vectors
    velocity_mps: Vectors
    acceleration_mps2: Vectors
    heading_rad: list[Angle]
    north_error_rad: list[Angle] = []
    clock_offset_s: list[Seconds] = []
    azimuth_bias_rad: list[Angle] = []
    range_bias_m: list[Real] = []
    range_scale: list[Real] = []
