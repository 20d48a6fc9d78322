"""Ranges from a carrier to beacons and to other carriers: true distance, clocks, errors, noise."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from schemas.messages import TruthCarriers

from .motion import Kinematics
from .noise import TargetDraws, generator, normal, stable_hash
from .scenario.declared import beacon_place_m
from .scenario.file import ScenarioFile
from .scenario.ranging import Ranging
from .schedule import Look, looks


class Measured(NamedTuple):
    """One range, pseudorange or range difference.

    Attributes:
        reference: whose range was taken away in a difference, else empty.
        sigma_m: of `value_m`.
    """

    peer: str
    reference: str
    value_m: float
    sigma_m: float


class RangingError(NamedTuple):
    """The actual errors of a ranging device, the clock's as the way of light."""

    bias_m: float
    scale: float
    clock_m: float
    clock_drift_mps: float


class _Heard(NamedTuple):
    """What a look heard: peers in the order of the table, their measured ranges (P,) [m]."""

    peers: list[str]
    range_m: Array


class RangingDevice:
    """One ranging device of a carrier; pure: the same look at the same truth measures the same."""

    def __init__(self, file: ScenarioFile, carrier: str, table: Ranging) -> None:
        self.table = table
        self._file, self._carrier = file, carrier
        self._step_ns = round(file.time.step_s * 1e9)
        self._error = ranging_error(file, carrier, table)
        self._draws = TargetDraws.of(file.seed, "ranging", carrier, table.kind)
        self._beacons = {b.name: beacon_place_m(file, b) for b in file.beacons}
        self._clocks = dict(_clocks(file)) if table.kind == "pseudorange" else {}

    def due(self, step: int) -> list[Look]:
        """The looks after the step before, up to this one."""
        table = self.table
        return looks(step, self._step_ns, period_s=table.period_s, phase_s=table.phase_s)

    def measure(self, look: Look, step: int, carriers: TruthCarriers) -> list[Measured]:
        """What one look measures, in the order of the peers."""
        heard = self._hear(look, step, carriers)
        sigma = self.table.sigma_m
        if self.table.kind != "difference":
            values = zip(heard.peers, heard.range_m.tolist(), strict=True)
            return [Measured(peer, "", value, sigma) for peer, value in values]
        if not heard.peers or heard.peers[0] != self.table.to[0]:
            return []  # without the reference there is no difference
        reference, *others = heard.peers
        values = zip(others, (heard.range_m[1:] - heard.range_m[0]).tolist(), strict=True)
        return [Measured(peer, reference, value, sigma * 2**0.5) for peer, value in values]

    def _hear(self, look: Look, step: int, carriers: TruthCarriers) -> _Heard:
        table, error, after_s = self.table, self._error, look.after_step_ns * 1e-9
        places = dict(_places(carriers, after_s)) | self._beacons
        peers = [name for name in table.to if name in places]
        between = [places[name] - places[self._carrier] for name in peers]
        true = np.linalg.norm(np.array(between).reshape(-1, 3), axis=1)
        detection, noise, outlier = self._draw(look, peers)
        value = true * (1 + error.scale) + error.bias_m
        value += table.sigma_m * normal(noise)[:, 0]
        value += self._clock_m(peers, step * self._file.time.step_s + after_s)
        least, most = table.outlier_m
        gross = outlier[:, 0] < table.outlier_share
        value += np.where(gross, least + (most - least) * outlier[:, 1], 0.0)
        kept = np.flatnonzero(
            (detection[:, 0] < table.detection_probability) & (true <= table.range_max_m)
        )
        return _Heard([peers[n] for n in kept], value[kept])

    def _draw(self, look: Look, peers: list[str]) -> Array:
        """Draws (3, P, 2) for detection, noise and reflection."""
        numbers = np.array([stable_hash(name, bits=32) for name in peers], dtype=np.uint64)
        purposes = ("detection", "range", "outlier")
        return self._draws.at(numbers, [(look.number, purpose) for purpose in purposes])

    def _clock_m(self, peers: list[str], t_s: float) -> Array:
        """Receiver's clock less the senders' (P,), as the way of light; a beacon's is right."""
        clocks = self._clocks
        shown = [_shown_m(clocks[name], t_s) if name in clocks else 0.0 for name in peers]
        own = _shown_m(clocks[self._carrier], t_s) if self._carrier in clocks else 0.0
        return own - np.array(shown)


def ranging_error(file: ScenarioFile, carrier: str, table: Ranging) -> RangingError:
    """The errors given in the file, or drawn from their sigmas; all zero where disabled."""
    if not file.errors.enabled:
        return RangingError(0.0, 0.0, 0.0, 0.0)
    sigmas = (
        table.sigma_range_bias_m,
        table.sigma_range_scale,
        table.sigma_clock_m,
        table.sigma_clock_drift_mps,
    )
    errors = table.errors
    given = (errors.range_bias_m, errors.range_scale, errors.clock_m, errors.clock_drift_mps)
    draws = generator(file.seed, "ranging", carrier, table.kind, "errors").standard_normal(4)
    return RangingError(
        *(
            float(sigma * draw) if value is None else value
            for sigma, draw, value in zip(sigmas, draws, given, strict=True)
        )
    )


def _clocks(file: ScenarioFile) -> Iterator[tuple[str, RangingError]]:
    """The clocks of all carriers that take or are heard in pseudoranges by one of their own."""
    for carrier in file.carriers:
        for table in carrier.ranging:
            if table.kind == "pseudorange":
                yield carrier.name, ranging_error(file, carrier.name, table)


def _shown_m(error: RangingError, t_s: float) -> float:
    return error.clock_m + error.clock_drift_mps * t_s


def _places(carriers: TruthCarriers, after_s: float) -> Iterator[tuple[str, Array]]:
    """Where every carrier is (3,), a moment after the step."""
    rows = zip(
        carriers.carrier,
        carriers.position_m,
        carriers.velocity_mps,
        carriers.acceleration_mps2,
        strict=True,
    )
    for name, *motion in rows:
        moved = Kinematics(*(np.array(row, dtype=float) for row in motion)).after(after_s)
        yield name, moved.position_m
