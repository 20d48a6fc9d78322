"""Targets by kind of motion over a grid of instants: drawn at random, or cut from recorded tracks.

All motions are laid at random into a square about the radars: the middle of each lies within it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, Indices

STEP_S = 0.25
"""Between two instants; radars turn in multiples of it."""


class World(NamedTuple):
    """N targets at S instants, `STEP_S` apart.

    Attributes:
        half_m: of the square in which the middles of their ways lie.
        kinds: names; kind: (N,) the row of each target's in it.
        place_m, velocity_mps: (S, N, 2) east, north.
        alive: (S, N).
        turning, hastening: (S, N) whether it turns, or changes speed.
    """

    half_m: float
    kinds: tuple[str, ...]
    kind: Indices
    place_m: Array
    velocity_mps: Array
    alive: NDArray[np.bool_]
    turning: NDArray[np.bool_]
    hastening: NDArray[np.bool_]


class Kind(NamedTuple):
    """A kind of targets: from what their motions are drawn, each evenly.

    Attributes:
        speed_mps: least and greatest.
        turn_deg_s: of turns, to either side; by_deg: how far they go.
        hasten_mps2: of changes of speed, for `HASTENS_S`.
    """

    name: str
    speed_mps: tuple[float, float]
    turn_deg_s: tuple[float, float] = (0.0, 0.0)
    by_deg: tuple[float, float] = (20.0, 150.0)
    hasten_mps2: tuple[float, float] = (0.0, 0.0)


HASTENS_S = (10.0, 40.0)
RESTS_S = (30.0, 120.0)  # between two manoeuvres
SHIPS = (
    Kind("moored", (0.0, 0.0)),
    Kind("ships, straight", (2.0, 18.0)),
    Kind("ships that turn", (2.0, 18.0), turn_deg_s=(0.3, 3.0)),
    Kind("ships that change speed", (2.0, 18.0), hasten_mps2=(0.01, 0.1)),
)
AIRCRAFT = (
    Kind("aircraft, straight", (100.0, 250.0)),
    Kind("aircraft that turn", (100.0, 250.0), turn_deg_s=(1.0, 4.0)),
    Kind("aircraft that change speed", (100.0, 250.0), hasten_mps2=(0.5, 3.0)),
)


def drawn(
    rng: np.random.Generator, kinds: Sequence[Kind], each: int, seconds: float, half_m: float
) -> World:
    """`each` targets of every kind, now and then in a manoeuvre."""
    ways = [_way(rng, kind, round(seconds / STEP_S)) for kind in kinds for _ in range(each)]
    velocity, turning, hastening = (np.stack(part, axis=1) for part in zip(*ways, strict=True))
    place = laid(rng, velocity, half_m)
    rows = np.repeat(np.arange(len(kinds)), each)
    names = tuple(kind.name for kind in kinds)
    return World(
        half_m, names, rows, place, velocity, np.ones(turning.shape, bool), turning, hastening
    )


def laid(rng: np.random.Generator, velocity_mps: Array, half_m: float) -> Array:
    """Ways (S, N, 2) of such velocities so that their middles lie in the square."""
    steps = (velocity_mps[1:] + velocity_mps[:-1]) * (STEP_S / 2)
    place = np.concatenate([np.zeros_like(velocity_mps[:1]), np.cumsum(steps, axis=0)])
    middle = rng.uniform(-half_m, half_m, place.shape[1:])
    return np.asarray(place - place[len(place) // 2] + middle)


def _way(
    rng: np.random.Generator, kind: Kind, steps: int
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Velocities (S, 2) of one target, and when it turns and changes speed."""
    rate, pull = np.zeros(steps), np.zeros(steps)
    speed = rng.uniform(*kind.speed_mps)
    now, to = rng.uniform(0, RESTS_S[1]), speed
    while now < steps * STEP_S and (kind.turn_deg_s[1] or kind.hasten_mps2[1]):
        begin = round(now / STEP_S)
        if kind.turn_deg_s[1]:
            turn = np.radians(rng.uniform(*kind.turn_deg_s))
            lasts = np.radians(rng.uniform(*kind.by_deg)) / turn
            rate[begin : begin + round(lasts / STEP_S)] = turn * rng.choice([-1, 1])
        else:
            lasts, hard = rng.uniform(*HASTENS_S), rng.uniform(*kind.hasten_mps2)
            by = _by(rng, hard * lasts, to, kind)
            to += by
            pull[begin : begin + round(lasts / STEP_S)] = by / lasts
        now += lasts + rng.uniform(*RESTS_S)
    course = rng.uniform(0, 2 * np.pi) + np.cumsum(rate) * STEP_S
    speeds = speed + np.cumsum(pull) * STEP_S
    velocity = speeds[:, None] * np.column_stack([np.sin(course), np.cos(course)])
    return velocity, rate != 0, pull != 0


def _by(rng: np.random.Generator, change: float, speed: float, kind: Kind) -> float:
    """A change of speed up or down that keeps it within the kind's limits."""
    least, greatest = kind.speed_mps
    up, down = min(speed + change, greatest) - speed, max(speed - change, least) - speed
    return float(rng.choice([up, down]) if min(up, -down) > 0 else max(up, down, key=abs))


def in_pairs(
    rng: np.random.Generator,
    apart_m: Sequence[float],
    each: int,
    speed_mps: float,
    seconds: float,
    half_m: float,
) -> World:
    """Pairs side by side, `each` of every distance, that rest or go straight in company."""
    pairs, steps = each * len(apart_m), round(seconds / STEP_S)
    course, aside = rng.uniform(0, 2 * np.pi, (2, pairs))
    velocity = speed_mps * np.column_stack([np.sin(course), np.cos(course)])
    velocity = np.broadcast_to(velocity, (steps, pairs, 2))
    place, off = laid(rng, velocity, half_m), np.column_stack([np.sin(aside), np.cos(aside)])
    off *= np.repeat(apart_m, each)[:, None] / 2
    place = np.concatenate([place - off, place + off], axis=1)
    rows = np.tile(np.repeat(np.arange(len(apart_m)), each), 2)
    never = np.zeros(place.shape[:2], dtype=bool)
    names = tuple(f"{distance:g} m" for distance in apart_m)
    velocity = np.concatenate([velocity, velocity], axis=1)
    return World(half_m, names, rows, place, velocity, ~never, never, never)
