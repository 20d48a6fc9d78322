"""Small scenes with a known truth, made with numpy: what carriers would say of them.

True bearing = reported bearing + c, so `north_error_rad` is the c of its carrier, and what the
fusion centre should find in own axes is `Scene.truth`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.consistency import nees
from estimation.frames import (
    Site,
    enu_from_geodetic,
    geodetic_from_enu,
    on_surface,
    polar_from_east_north,
    rotation_clockwise,
    site_at,
    target_from_source,
    wrap_pi,
    yaw_rad,
)
from fusion_center import pipeline
from fusion_center.settings import settings_from
from fusion_center.state import State
from schemas import codec
from schemas.messages import (
    Association,
    Closed,
    Correction,
    DeclaredCarrier,
    DeclaredScenario,
    Event,
    Input,
    Navigation,
    Origin,
    Pose,
    Quality,
    SourceInfo,
    SourceProperties,
    SourceQuality,
    SourceReport,
    StreamEnd,
)

EPOCH_NS = 1_767_225_600_000_000_000
STEP_NS = 1_000_000_000
CLOSED_FORM = {"registration": {"method": "closed_form"}}
"""Settings of the memoryless baseline."""
ORIGIN = Site(math.radians(41.0), math.radians(29.0))


@dataclass(frozen=True)
class Ship:
    """A carrier: what it is, how it errs, how long before a step it looks, since when it lives."""

    name: str
    at_m: tuple[float, float] = (0.0, 0.0)
    velocity_mps: tuple[float, float] = (0.0, 0.0)
    position_error_m: tuple[float, float] = (0.0, 0.0)
    north_error_rad: float = 0.0
    sigma_bearing_rad: float = math.radians(0.5)
    sigma_range_m: float = 100.0
    sigma_position_m: float = 1500.0
    sigma_north_rad: float = math.radians(1.0)
    coordinates: str = "bearing_range"
    range_max_m: float = 1e9
    clock_offset_ns: int = 0
    looks_before_s: float = 0.0
    boot: str = "b1"
    since_step: int = 0

    @property
    def properties(self) -> SourceProperties:
        return SourceProperties(
            coordinates=self.coordinates,  # type: ignore[arg-type]
            sigma_bearing_rad=self.sigma_bearing_rad,
            sigma_range_m=self.sigma_range_m,
            sigma_position_m=self.sigma_range_m,
            range_max_m=self.range_max_m,
        )


class Truth(NamedTuple):
    """Position and orientation of another carrier in own sensor axes."""

    q_m: Array
    D_rad: float


@dataclass(frozen=True)
class Scene:
    """Ships, and targets with or without a name that every ship can see."""

    ships: tuple[Ship, ...]
    targets_m: Array
    velocities_mps: Array | None = None
    identities: Sequence[str | None] | None = None
    tracks: bool = True
    period_steps: int = 1
    fusion: dict[str, Any] = field(default_factory=dict)

    def scenario(self) -> DeclaredScenario:
        return DeclaredScenario(
            name="scene",
            origin=Origin(latitude_rad=ORIGIN.latitude_rad, longitude_rad=ORIGIN.longitude_rad),
            epoch_ns=EPOCH_NS,
            step_ns=STEP_NS,
            steps=100,
            carriers=[
                DeclaredCarrier(
                    name=ship.name,
                    sigma_position_m=ship.sigma_position_m,
                    sigma_north_rad=ship.sigma_north_rad,
                )
                for ship in self.ships
            ],
            fusion=self.fusion,
        )

    def initial(self) -> State:
        return pipeline.initial(self.scenario(), settings_from(self.fusion))

    def true_site(self, ship: Ship, step: float) -> Site:
        at = np.add(ship.at_m, np.multiply(ship.velocity_mps, step))
        return site_at(ORIGIN, on_surface(ORIGIN, *at))

    def reported_site(self, ship: Ship, step: float) -> Site:
        at = np.add(ship.at_m, np.multiply(ship.velocity_mps, step)) + ship.position_error_m
        return site_at(ORIGIN, on_surface(ORIGIN, *at))

    def truth(self, other: str, step: float, own: str | None = None) -> Truth:
        one, two = self.ship(own or self.ships[0].name), self.ship(other)
        true = target_from_source(self.true_site(one, step), self.true_site(two, step))
        known = target_from_source(self.reported_site(one, step), self.reported_site(two, step))
        turn = two.north_error_rad - one.north_error_rad + yaw_rad(true) - yaw_rad(known)
        q = rotation_clockwise(-one.north_error_rad) @ true.translation_m[:2]
        return Truth(q, float(turn))

    def ship(self, name: str) -> Ship:
        return next(ship for ship in self.ships if ship.name == name)

    def info(self, ship: Ship) -> SourceInfo:
        return SourceInfo(
            carrier=ship.name,
            boot=ship.boot,
            stream="info",
            seq=1,
            t_ns=EPOCH_NS,
            source="radar",
            properties=ship.properties,
        )

    def navigation(self, ship: Ship, step: int) -> Navigation:
        when = step - ship.looks_before_s
        here = self.reported_site(ship, when)
        way = rotation_clockwise(-ship.north_error_rad) @ np.multiply(ship.velocity_mps, when)
        return Navigation(
            carrier=ship.name,
            boot=ship.boot,
            stream="navigation",
            seq=step - ship.since_step,
            t_ns=stamp(step, ship),
            step=step,
            pose=Pose(latitude_rad=here.latitude_rad, longitude_rad=here.longitude_rad),
            reckoned_east_m=float(way[0]),
            reckoned_north_m=float(way[1]),
        )

    def polar(self, ship: Ship, step: float) -> tuple[Array, Array]:
        """Noiseless bearings from the ship's own north and slant ranges of all targets."""
        moved = 0.0 if self.velocities_mps is None else self.velocities_mps * step
        east, north = (self.targets_m + moved).T
        where = geodetic_from_enu(ORIGIN, on_surface(ORIGIN, east, north))
        enu = enu_from_geodetic(self.true_site(ship, step), *where)
        bearing, _ = polar_from_east_north(enu[:, :2])
        return wrap_pi(bearing - ship.north_error_rad), np.linalg.norm(enu, axis=1)

    def report(self, ship: Ship, step: int, rng: np.random.Generator | None = None) -> SourceReport:
        bearing, slant = self.polar(ship, step - ship.looks_before_s)
        if rng is not None:
            bearing = wrap_pi(bearing + rng.normal(0, ship.sigma_bearing_rad, bearing.shape))
            slant = slant + rng.normal(0, ship.sigma_range_m, slant.shape)
        n = len(bearing)
        return SourceReport(
            carrier=ship.name,
            boot=ship.boot,
            stream="radar",
            seq=1 + (step - ship.since_step - 1) // self.period_steps,
            t_ns=stamp(step, ship),
            step=step,
            bearing_rad=bearing.tolist(),
            sigma_bearing_rad=[ship.sigma_bearing_rad] * n,
            range_m=None if ship.coordinates == "bearing" else slant.tolist(),
            sigma_range_m=None if ship.coordinates == "bearing" else [ship.sigma_range_m] * n,
            track_id=[f"t{i}" for i in range(n)] if self.tracks else None,
            identity=None if self.identities is None else list(self.identities),
            identity_kind=None if self.identities is None else ["name"] * n,
        )

    def said(self, step: int, rng: np.random.Generator | None = None) -> list[Input]:
        """Everything the ships say at a step."""
        messages: list[Input] = []
        for ship in self.ships:
            if step == 1:
                messages.append(self.info(ship))
            messages.append(self.navigation(ship, step))
            if (step - 1) % self.period_steps == 0:
                messages.append(self.report(ship, step, rng))
        return messages

    def run(
        self, steps: int, rng: np.random.Generator | None = None, state: State | None = None
    ) -> tuple[State, list[pipeline.Outputs]]:
        """Fuse steps 1 .. `steps`, one Closed each."""
        state, outputs = state or self.initial(), []
        for step in range(1, steps + 1):
            messages = self.said(step, rng)
            state, out = pipeline.step(state, closed(step, messages), messages)
            outputs.append(out)
        return state, outputs


def stamp(step: float, ship: Ship | None = None) -> int:
    if ship is None:
        return EPOCH_NS + round(step * STEP_NS)
    return stamp(step - ship.looks_before_s) + ship.clock_offset_ns


def closed(step: int, messages: Iterable[Input], **more: Any) -> Closed:
    """The Closed that names these messages."""
    last: dict[tuple[str, str, str], int] = {}
    for m in messages:
        last[m.carrier, m.boot, m.stream] = max(m.seq, last.get((m.carrier, m.boot, m.stream), 0))
    manifest = [
        StreamEnd(carrier=c, boot=b, stream=s, last_seq=seq) for (c, b, s), seq in last.items()
    ]
    return Closed(step=step, t_ns=more.pop("t_ns", stamp(step)), manifest=manifest, **more)


def targets_around(rng: np.random.Generator, count: int, side_m: float = 30_000.0) -> Array:
    """Targets uniform in a square about the origin, none nearer than 1 km to it."""
    points = rng.uniform(-side_m / 2, side_m / 2, (4 * count + 20, 2))
    return points[np.hypot(*points.T) > 1000.0][:count]


def named(count: int) -> list[str]:
    return [f"n{i}" for i in range(count)]


def correction(outputs: pipeline.Outputs, carrier: str = "b") -> Correction:
    found = [
        out.message
        for out in outputs
        if isinstance(out.message, Correction) and out.message.carrier == carrier
    ]
    assert len(found) == 1
    return found[0]


def as_bytes(outputs: Iterable[pipeline.Outputs]) -> list[tuple[str, bytes]]:
    """Outputs as they would be published."""
    return [
        (out.topic.key("run", *out.ids), codec.encode(out.message))
        for out in chain.from_iterable(outputs)
    ]


def own_axes_score(found: Correction, truth: Truth) -> float:
    """Normalised estimation error squared of (q, D), per dimension."""
    axes = found.own_axes
    assert axes is not None
    error = [
        axes.east_m - truth.q_m[0],
        axes.north_m - truth.q_m[1],
        axes.rotation_rad - truth.D_rad,
    ]
    return float(nees(error, matrix(axes.covariance, 3))) / 3


def drawn(scene: Scene, rng: np.random.Generator) -> Scene:
    """The scene with the errors of its ships drawn from what they declare."""
    ships = tuple(
        replace(
            ship,
            position_error_m=tuple(rng.normal(0, ship.sigma_position_m, 2)),
            north_error_rad=float(rng.normal(0, ship.sigma_north_rad)),
        )
        for ship in scene.ships
    )
    return replace(scene, ships=ships)


def matrix(triangle: Sequence[float], order: int) -> Array:
    """A covariance from its upper triangle."""
    full = np.zeros((order, order))
    full[np.triu_indices(order)] = triangle
    return np.triu(full) + np.triu(full, 1).T


def two_ships(count: int = 8, *, seed: int = 1, identities: bool = True, **more: Any) -> Scene:
    """Own ship a at the origin and ship b 12 km away, errors of the paper's size."""
    rng = np.random.default_rng(seed)
    return Scene(
        ships=(
            Ship("a", position_error_m=(300.0, -500.0), north_error_rad=math.radians(0.7)),
            Ship(
                "b",
                at_m=(9000.0, 8000.0),
                position_error_m=(-900.0, 700.0),
                north_error_rad=math.radians(-0.9),
            ),
        ),
        targets_m=targets_around(rng, count),
        identities=named(count) if identities else None,
        **more,
    )


def without(messages: list[Input], carrier: str) -> list[Input]:
    return [message for message in messages if message.carrier != carrier]


def quality(outputs: pipeline.Outputs) -> Quality:
    return next(o.message for o in outputs if isinstance(o.message, Quality))


def association(outputs: pipeline.Outputs) -> Association:
    return next(o.message for o in outputs if isinstance(o.message, Association))


def of_radar(outputs: pipeline.Outputs, carrier: str) -> SourceQuality:
    rows = quality(outputs).sources
    return next(row for row in rows if (row.carrier, row.source) == (carrier, "radar"))


def event(step: int, seq: int = 1, **more: Any) -> Event:
    return Event(centre="fusion", seq=seq, step=step, t_ns=stamp(step), id=f"e{seq}", **more)
