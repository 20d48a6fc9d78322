"""The picture against the truth in the same recording: GOSPA, errors and NEES of tracks, counts.

Truth is put where the own carrier believes it to be: its reported pose and its own north are the
gauge of the picture, and what they get wrong moves the whole of it.
"""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Iterable, Iterator, Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from estimation.frames import (
    Site,
    geodetic_from_enu,
    on_surface,
    rotation_clockwise,
    site_at,
    target_from_source,
)
from estimation.metrics import gospa, matched, matched_nees
from schemas.messages import (
    DeclaredScenario,
    Navigation,
    Pose,
    Tracks,
    TruthCarriers,
    TruthTargets,
)

from .frames import place_at, reported_at, sensor_norths_rad, symmetric

CUTOFF_M = 500.0
"""GOSPA's c: a track further from all targets is false, a target further from all tracks missed."""

KEPT = 4_096
"""Steps of the truth, and poses, that pictures may still be compared with."""

PLACE_DIMENSIONS = 2
"""Of a place in the picture."""

Known = Tracks | TruthTargets | TruthCarriers | Navigation


class PictureError(NamedTuple):
    """The picture of one Closed against the truth.

    Attributes:
        gospa_m: p = 2, alpha = 2, c = `CUTOFF_M`.
        localisation_m, missed_m, false_m: its parts, that add up in squares.
        missed, false: objects.
        error_m: root mean square of the matched tracks; nan without any.
        sigma_m: what the matched tracks claim, root of their mean summed variances.
        nees: mean over matched tracks of their places, two degrees of freedom each.
        pairs: number of a true target and id of the track that matches it.
    """

    step: int
    t_ns: int
    targets: int
    tracks: int
    gospa_m: float
    localisation_m: float
    missed_m: float
    false_m: float
    missed: int
    false: int
    error_m: float
    sigma_m: float
    nees: float
    pairs: tuple[tuple[int, str], ...]


class PictureSummary(Struct, frozen=True, kw_only=True):
    """Over the second half of a run, when the frames have converged; nan where nothing was.

    Attributes:
        pictures: that were judged; all that follows are means over them.
        gospa_m: and the root mean squares of its parts, that add up in squares.
        error_m: root mean square of the places of tracks; sigma_m: what they claim.
        nees_per_dimension: of those places; 1 where their covariance is honest.
        identity_changes: how often a target was taken over by another track, in all.
    """

    pictures: int
    targets: float
    tracks: float
    missed: float
    false: float
    gospa_m: float
    localisation_m: float
    missed_m: float
    false_m: float
    error_m: float
    sigma_m: float
    nees_per_dimension: float
    identity_changes: int


def picture_errors(
    scenario: DeclaredScenario, own: str, messages: Iterable[Known]
) -> list[PictureError]:
    """Every picture that the truth of its step is known of, in order of arrival."""
    judge = Judge(scenario, own)
    return [error for message in messages for error in judge.errors(message)]


def summarise_picture(errors: Sequence[PictureError]) -> PictureSummary | None:
    """The second half; None where there was no picture to judge."""
    late = errors[len(errors) // 2 :]
    if not late:
        return None
    nees = [error.nees for error in late if error.pairs]
    return PictureSummary(
        pictures=len(late),
        targets=_mean([e.targets for e in late]),
        tracks=_mean([e.tracks for e in late]),
        missed=_mean([e.missed for e in late]),
        false=_mean([e.false for e in late]),
        gospa_m=_mean([e.gospa_m for e in late]),
        localisation_m=_rms([e.localisation_m for e in late]),
        missed_m=_rms([e.missed_m for e in late]),
        false_m=_rms([e.false_m for e in late]),
        error_m=_rms([e.error_m for e in late if e.pairs]),
        sigma_m=_rms([e.sigma_m for e in late if e.pairs]),
        nees_per_dimension=_mean(nees) / PLACE_DIMENSIONS,
        identity_changes=int(names_changed(late)[-1]),
    )


def names_changed(errors: Sequence[PictureError]) -> np.ndarray:
    """How often until each picture (n,) a target was taken over by another track."""
    changes = np.zeros(len(errors), dtype=int)
    held: dict[int, str] = {}
    for n, error in enumerate(errors):
        pairs = dict(error.pairs)
        changes[n] = sum(held.get(target, track) != track for target, track in pairs.items())
        held |= pairs
    total: np.ndarray = np.cumsum(changes)
    return total


class Judge:
    """Remembers the last truth and the own carrier's navigation as they pass by."""

    def __init__(self, scenario: DeclaredScenario, own: str) -> None:
        origin = scenario.origin
        self._origin = Site(origin.latitude_rad, origin.longitude_rad, origin.altitude_m)
        self._own = own
        self._targets: dict[int, TruthTargets] = {}
        self._carriers: dict[int, TruthCarriers] = {}
        self._steps: list[tuple[int, int]] = []
        self._navigation: list[Navigation] = []

    def errors(self, message: Known) -> Iterator[PictureError]:
        """The error of a picture; nothing of anything else."""
        match message:
            case TruthTargets():
                self._targets[message.step] = message
                insort(self._steps, (message.t_ns, message.step))
                self._forget()
            case TruthCarriers():
                self._carriers[message.step] = message
            case Navigation() if message.carrier == self._own:
                insort(self._navigation, message, key=_time)
                del self._navigation[:-KEPT]
            case Tracks():
                yield from self._judged(message)

    def _forget(self) -> None:
        for _, step in self._steps[:-KEPT]:
            self._targets.pop(step, None)
            self._carriers.pop(step, None)
        del self._steps[:-KEPT]

    def _judged(self, picture: Tracks) -> Iterator[PictureError]:
        step = self._step_at(picture.t_ns)
        reported = reported_at(self._navigation, picture.t_ns)
        if step not in self._targets or step not in self._carriers or reported is None:
            return
        targets, carriers = self._targets[step], self._carriers[step]
        if self._own not in carriers.carrier:
            return
        true = self._true_m(targets, carriers, reported, picture.t_ns)
        yield _compared(picture, targets.number, true)

    def _step_at(self, t_ns: int) -> int:
        at = bisect_right(self._steps, (t_ns, 2**62)) - 1
        return self._steps[at][1] if at >= 0 else -1

    def _true_m(
        self, targets: TruthTargets, carriers: TruthCarriers, reported: Pose, t_ns: int
    ) -> np.ndarray:
        """Places (n, 2) of the targets as own sensors would put them without noise.

        The picture is of the instant at which the own clock shows `t_ns`.
        """
        index = carriers.carrier.index(self._own)
        clock_s = carriers.clock_offset_s[index] if carriers.clock_offset_s else 0.0
        passed_s = (t_ns - targets.t_ns) * 1e-9 - clock_s
        moves = (targets.position_m, targets.velocity_mps, targets.acceleration_mps2)
        start, velocity, acceleration = (np.array(m, dtype=float).reshape(-1, 3) for m in moves)
        place = start + passed_s * (velocity + passed_s / 2 * acceleration)
        here = place_at(carriers, index, t_ns)
        own = site_at(self._origin, here)
        seen = target_from_source(own, self._origin).apply(place)[:, :2]
        seen = seen @ rotation_clockwise(-sensor_norths_rad(carriers)[index]).T
        altitude = geodetic_from_enu(self._origin, place)[2]
        believed = Site(reported.latitude_rad, reported.longitude_rad, reported.altitude_m)
        enu = on_surface(believed, seen[:, 0], seen[:, 1], altitude)
        return target_from_source(self._origin, believed).apply(enu)[:, :2]


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")


def _rms(values: Sequence[float]) -> float:
    return sqrt(_mean([value**2 for value in values]))


def _claimed_m(spread: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.trace(spread[:, :2, :2], axis1=1, axis2=2))))


def _time(message: Navigation) -> int:
    return message.t_ns


def _compared(picture: Tracks, number: list[int], true: np.ndarray) -> PictureError:
    found = np.array([track.position_m[:2] for track in picture.tracks], dtype=float).reshape(-1, 2)
    score = gospa(true, found, CUTOFF_M)
    pairs = matched(true, found, CUTOFF_M)
    spread = np.array([symmetric(track.covariance)[:2, :2] for track in picture.tracks])
    nees = matched_nees(true, found, spread.reshape(-1, 2, 2), pairs)
    apart = true[pairs.truth] - found[pairs.estimate]
    return PictureError(
        step=picture.step,
        t_ns=picture.t_ns,
        targets=len(true),
        tracks=len(found),
        gospa_m=float(score.distance),
        localisation_m=float(score.localisation),
        missed_m=float(score.missed),
        false_m=float(score.false),
        missed=len(true) - len(pairs.truth),
        false=len(found) - len(pairs.truth),
        error_m=float(np.sqrt(np.mean((apart**2).sum(axis=1)))) if len(apart) else float("nan"),
        sigma_m=_claimed_m(spread[pairs.estimate]) if len(apart) else float("nan"),
        nees=float(np.mean(nees)) if len(apart) else float("nan"),
        pairs=tuple(
            (number[i], picture.tracks[j].id)
            for i, j in zip(pairs.truth.tolist(), pairs.estimate.tolist(), strict=True)
        ),
    )
