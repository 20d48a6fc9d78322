"""The tracker as the fusion centre has it, on a world, and how good its tracks are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bench.motions.scoring import SETTLED_S, Errors, errors_of
from bench.motions.sights import LENGTH, Sight, extent_m
from bench.motions.worlds import STEP_S, World
from estimation.metrics import Picture, gospa_over_time, identity_changes, matched_over_time
from estimation.tracking.features import Layout
from estimation.tracking.imm import Motion
from estimation.tracking.tracker import Settings, nothing, shown, step
from estimation.tracking.undetected import Region
from fusion_center.picture.ways import motion_of
from fusion_center.settings import PictureSettings

CUT_M = 500.0
"""Of GOSPA, and beyond which no track is of a target."""

_LEAST_SHARE = 0.5  # of a target's instants that have a track; with fewer it counts as lost


class Tracked(NamedTuple):
    """Of a run, from `SETTLED_S` of its own life on for each target.

    Attributes:
        errors: of the targets with a track.
        gospa_m: mean over time.
        missed: share (targets,) of the instants of each without a track, nan if it has none.
        false: mean number of tracks without a target.
        changes: (targets,) how often each is held by another track than before.
    """

    errors: Errors
    gospa_m: float
    missed: np.ndarray
    false: float
    changes: np.ndarray


def settings_for(world: World, motion: Motion | None = None, lengths: bool = False) -> Settings:
    """The defaults of the fusion centre, on the region of the world."""
    given = PictureSettings()
    return Settings(
        motion=motion or motion_of(given),
        region=Region((0.0, 0.0), extent_m(world)),
        lifetime_s=given.lifetime_s,
        gate=given.gate,
        confirmed=given.confirmed,
        features=LENGTH if lengths else Layout(),
    )


def tracked(world: World, sights: Sequence[Sight], settings: Settings) -> Tracked:
    """Track and judge, at the end of each round of the radars."""
    picture, rows, found = nothing(settings, 0), [], []
    for sight in sights:
        picture, _ = step(picture, sight.scan, settings)
        if sight.ends_round and sight.row * STEP_S >= SETTLED_S:
            rows.append(sight.row)
            found.append(shown(picture, settings))
    targets = [np.flatnonzero(world.alive[row]) for row in rows]
    truth = Picture(
        np.repeat(rows, [len(each) for each in targets]),
        np.concatenate(targets),
        np.concatenate([world.place_m[row, each] for row, each in zip(rows, targets, strict=True)]),
    )
    shows = Picture(
        np.repeat(rows, [len(each.identity) for each in found]),
        np.concatenate([each.identity for each in found]),
        np.concatenate([each.mean[:, :2] for each in found]),
    )
    pairs = matched_over_time(truth, shows, CUT_M)
    row, target = truth.step[pairs.truth], truth.identity[pairs.truth]
    mean = np.concatenate([each.mean for each in found])[pairs.estimate]
    covariance = np.concatenate([each.covariance for each in found])[pairs.estimate]
    total = gospa_over_time(truth, shows, CUT_M)
    number = world.kind.size
    held = np.bincount(target, minlength=number)
    there = np.bincount(truth.identity, minlength=number)
    holder = shows.identity[pairs.estimate]
    changes = [identity_changes(row[t], target[t], holder[t]) for t in _each(target, number)]
    return Tracked(
        errors_of(world, row, target, mean, covariance),
        float(total.distance.mean()),
        1.0 - held / np.where(there, there, np.nan),
        float(total.false_count.mean()),
        np.array(changes),
    )


def lost(run: Tracked, of: np.ndarray) -> int:
    """How many of some targets have no track for half of their time or more."""
    return int(np.sum(run.missed[of] > _LEAST_SHARE))


def _each(target: np.ndarray, number: int) -> list[np.ndarray]:
    """Rows of each of the targets."""
    order = np.argsort(target, kind="stable")
    return np.split(order, np.searchsorted(target[order], np.arange(1, number)))
