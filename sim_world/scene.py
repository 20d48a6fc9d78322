"""The truth of one step as arrays, and the geometry between a carrier and the targets."""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, ArrayLike
from estimation.frames import Site, site_at, target_from_source
from schemas.messages import TruthCarriers, TruthTargets

from .motion import Kinematics

TURN_RAD = 2 * pi


class Targets(NamedTuple):
    """The targets of one step, N rows.

    Attributes:
        number: keys of their draws, below 2^32.
        features: name -> values; words: name -> words, empty = none.
    """

    number: np.ndarray
    motion: Kinematics
    classes: np.ndarray
    identity: np.ndarray
    features: dict[str, Array]
    words: dict[str, np.ndarray]

    def take(self, rows: np.ndarray) -> Targets:
        """The same of some rows."""
        features = {name: values[rows] for name, values in self.features.items()}
        motion = self.motion.take(rows)
        words = {name: values[rows] for name, values in self.words.items()}
        named = self.classes[rows], self.identity[rows]
        return Targets(self.number[rows], motion, *named, features, words)


class Stand(NamedTuple):
    """A carrier at one step.

    Attributes:
        motion: of the carrier, vectors (3,).
        north_error_rad: bearing of its own north, clockwise from true north.
        origin: of the axes that its motion and the targets' are in.
    """

    motion: Kinematics
    north_error_rad: float
    clock_offset_s: float
    origin: Site


class Polar(NamedTuple):
    """Bearings from own north, slant ranges and elevations of N targets."""

    bearing_rad: Array
    range_m: Array
    elevation_rad: Array

    def take(self, rows: np.ndarray) -> Polar:
        """The same of some rows."""
        return Polar(*(values[rows] for values in self))


def targets_of(truth: TruthTargets) -> Targets:
    """The targets of a message."""
    rows = (truth.position_m, truth.velocity_mps, truth.acceleration_mps2)
    blank = [""] * len(truth.number)
    return Targets(
        number=np.array(truth.number, dtype=np.uint64),
        motion=Kinematics(*(np.array(r, dtype=float).reshape(-1, 3) for r in rows)),
        classes=np.array(truth.classes or blank, dtype=object),
        identity=np.array(truth.identity or blank, dtype=object),
        features={name: np.array(values) for name, values in truth.features.items()},
        words={name: np.array(values, dtype=object) for name, values in truth.words.items()},
    )


def stand_of(truth: TruthCarriers, carrier: str, origin: Site) -> Stand:
    """One carrier of a message.

    Raises:
        ValueError: it is not in the message.
    """
    n = truth.carrier.index(carrier)
    rows = (truth.position_m[n], truth.velocity_mps[n], truth.acceleration_mps2[n])
    motion = Kinematics(*(np.array(row, dtype=float) for row in rows))
    return Stand(motion, truth.north_error_rad[n], truth.clock_offset_s[n], origin)


def polar(stand: Stand, targets: Kinematics, dt_s: ArrayLike, axes_dt_s: float) -> Polar:
    """Where the targets are from the carrier `dt_s` after the step, one number or one a target.

    The axes are east-north-up where the carrier truly is at `axes_dt_s`, turned to its own north.
    A line of sight is straight and nothing stands in it, not even the horizon.
    """
    between = targets.after(dt_s).position_m - stand.motion.after(dt_s).position_m
    here = site_at(stand.origin, stand.motion.after(axes_dt_s).position_m)
    east, north, up = (between @ target_from_source(here, stand.origin).rotation.T).T
    level = np.hypot(east, north)
    bearing = np.mod(np.arctan2(east, north) - stand.north_error_rad, TURN_RAD)
    return Polar(bearing, np.hypot(level, up), np.arctan2(up, level))
