"""What is remembered of a group of carriers: their joint state, and what each of them rests on."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from .carriers import Told
from .links import Estimate, Monitor


class Member(Struct, frozen=True, kw_only=True, eq=False):
    """A carrier of the group.

    Attributes:
        boot: ordinal of the life it is of.
        start_t_ns: since when; t_ns: of validity of its place, by its own clock.
        start_m: (2,) place reported at the start, along the axes of the scenario.
        way_m: (2,) reckoned at t_ns, as the carrier says it.
        sigma: (13,) of its slots before the data.
        ranges, logs: used so far.
        refused: share of the last ranges that were out of line.
        fixed_t_ns: of the last position fix that was used, or of the start.
        heard: beacons that it has ranged to.
        ratio: posterior over prior sigma of the least determined combination of its constants.
        hidden: names of combinations that are undetermined; touched: the beacons in each of them.
        diagnosed_t_ns: when these were worked out; -1 = never.
        monitor: how far its correction has come; estimate: the last that was made of it.
    """

    boot: int
    start_t_ns: int
    t_ns: int
    start_m: NDArray[np.float64]
    way_m: NDArray[np.float64]
    sigma: NDArray[np.float64]
    ranges: int = 0
    logs: int = 0
    refused: float = 0.0
    fixed_t_ns: int
    heard: tuple[str, ...] = ()
    ratio: float = 1.0
    hidden: tuple[str, ...] = ()
    touched: tuple[tuple[str, ...], ...] = ()
    diagnosed_t_ns: int = -1
    monitor: Monitor = Monitor()
    estimate: Estimate | None = None


class Group(Struct, frozen=True, kw_only=True, eq=False):
    """Carriers that range to each other and to beacons: `estimation.joint_navigation.Joint`.

    Attributes:
        pivot_m: (3,) about which its axes are turned, in those of the scenario.
        names, mean, covariance, free: of the joint state.
        members: by carrier; targets: instant of the place of each, by block.
        told: what sources that track by themselves have said last, by block.
    """

    pivot_m: NDArray[np.float64]
    names: tuple[str, ...]
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    free: NDArray[np.int64]
    members: dict[str, Member] = {}
    targets: dict[str, int] = {}
    told: dict[str, Told] = {}
