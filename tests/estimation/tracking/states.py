"""Small banks and sensors to try the tracker's parts on."""

from __future__ import annotations

import numpy as np

from estimation.arrays import Array
from estimation.tracking.aside import unheard
from estimation.tracking.bernoulli import Tracks
from estimation.tracking.features import Layout, unknown
from estimation.tracking.imm import Bank, bare
from estimation.tracking.measurements import (
    Measurement,
    RangeRate,
    bearings,
    places,
    polar,
)

SITE = np.array([-3000.0, 1500.0])


def some_bank(rng: np.random.Generator, count: int, half_m: float = 20e3, models: int = 2) -> Bank:
    """Tracks anywhere, their models a little apart, every matrix a covariance."""
    centre = np.concatenate(
        [rng.uniform(-half_m, half_m, (2, count)), rng.normal(0, 80, (2, count))]
    )
    mean = centre[:, None] + rng.normal(0, 5, (4, models, count))
    root = rng.normal(0, 1, (models, count, 4, 4)) * [60.0, 60.0, 6.0, 6.0]
    covariance = np.moveaxis(np.swapaxes(root, -1, -2) @ root, (2, 3, 0, 1), (0, 1, 2, 3))
    share = rng.uniform(0.05, 0.95, (models, count))
    return bare(mean, covariance, share / share.sum(axis=0))


def tracks_of(bank: Bank) -> Tracks:
    """Tracks that surely exist, of which nothing else is known."""
    n = bank.model.shape[-1]
    known = unknown(Layout(), n)
    return Tracks(np.arange(n), np.ones(n), bank, np.ones((1, n)), known, unheard(n))


def plots_of(kind: str, rng: np.random.Generator, place_m: Array) -> Measurement:
    """Noisy plots of targets at (n, 2) by a sensor at `SITE`."""
    n = len(place_m)
    away = place_m - SITE
    bearing = np.arctan2(*away.T) + rng.normal(0, 0.004, n)
    far = np.hypot(*away.T) + rng.normal(0, 30, n)
    if kind == "polar":
        return polar(SITE, bearing, far, 0.004, rng.uniform(20, 40, n))
    if kind == "range rate":
        rate = RangeRate(rng.normal(0, 80, n), np.full(n, 80.0), np.array([5.0, -3.0]))
        return polar(SITE, bearing, far, 0.004, 30.0, rng.uniform(-1, 1, n), 0.0, rate)
    if kind == "bearing":
        return bearings(SITE, bearing, 0.004)
    root = rng.normal(0, 40, (n, 2, 2))
    return places(
        place_m + rng.normal(0, 40, (n, 2)), root @ np.swapaxes(root, 1, 2) + 400 * np.eye(2)
    )


KINDS = ("polar", "range rate", "bearing", "place")
