"""A world that is as the tracker believes it to be, and what its sensors see."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.tracking.imm import Motion
from estimation.tracking.measurements import polar
from estimation.tracking.scan import Scan, View
from estimation.tracking.tracker import Picture, Settings, nothing, step
from estimation.tracking.undetected import Region

BOX_M = 40_000.0
SETTINGS = Settings(region=Region((0.0, 0.0), BOX_M * 0.6, 12), lifetime_s=60.0)
SITES = np.array([[-15e3, -12e3], [16e3, -9e3], [1e3, 17e3]])
PERIOD_S = 1.0
DETECTION, CLUTTER = 0.9, 6.0  # false plots a scan
SIGMA_BEARING, SIGMA_RANGE = 0.003, 30.0


class World(NamedTuple):
    """Targets that move, appear and vanish as the tracker expects: (T, N, 4) and (T, N)."""

    states: Array
    alive: NDArray[np.bool_]


def world(
    rng: np.random.Generator, steps: int, targets: int, motion: Motion = SETTINGS.motion
) -> World:
    """Drawn from the tracker's own model."""
    total = targets + round(targets * steps * PERIOD_S / 60.0)
    place = rng.uniform(-BOX_M / 2, BOX_M / 2, (total, 2))
    state = np.column_stack([place, rng.normal(0, motion.sigma_speed_mps, (total, 2))])
    begins = np.where(np.arange(total) < targets, 0.0, rng.uniform(0, steps * PERIOD_S, total))
    ends = begins + rng.exponential(SETTINGS.lifetime_s, total)
    manoeuvres = rng.random(total) < motion.steady()[1]
    states, parts = [], 4
    dt = PERIOD_S / parts
    for _ in range(steps):
        states.append(state.copy())
        for _ in range(parts):
            leave = dt / np.where(manoeuvres, motion.quieter_s[0], motion.louder_s[0])
            manoeuvres ^= rng.random(total) < leave
            q = np.where(manoeuvres, *reversed(motion.noise))[:, None]
            kick = rng.normal(0, 1, (total, 2)) * np.sqrt(q * dt)
            state[:, :2] += state[:, 2:] * dt + kick * dt / 2
            state[:, 2:] += kick
    now = np.arange(steps)[:, None] * PERIOD_S
    return World(np.array(states), (now >= begins) & (now < ends))


def scans(rng: np.random.Generator, given: World) -> list[Scan]:
    """A scan each step, the sensors in turn."""
    every = []
    for k, (state, alive) in enumerate(zip(given.states, given.alive, strict=True)):
        site = SITES[k % len(SITES)]
        hit = state[alive & (rng.random(len(state)) < DETECTION), :2]
        ghosts = rng.uniform(-BOX_M / 2, BOX_M / 2, (rng.poisson(CLUTTER), 2))
        noise = rng.normal(size=(2, len(hit))) * [[SIGMA_BEARING], [SIGMA_RANGE]]
        noise = np.pad(noise, ((0, 0), (0, len(ghosts))))
        away = np.concatenate([hit, ghosts]) - site
        plots = polar(
            site,
            np.arctan2(*away.T) + noise[0],
            np.hypot(*away.T) + noise[1],
            SIGMA_BEARING,
            SIGMA_RANGE,
        )
        every.append(
            Scan(round(k * PERIOD_S * 1e9), plots, View(site), DETECTION, CLUTTER / BOX_M**2)
        )
    return every


def tracked(given: list[Scan], settings: Settings = SETTINGS) -> list[Picture]:
    """The picture after each scan."""
    picture, every = nothing(settings, 0), []
    for scan in given:
        picture, _ = step(picture, scan, settings)
        every.append(picture)
    return every
