"""System alignment against the truth: what ranges tell of places, norths and clocks of carriers.

Places lie along the axes of the scenario's origin, to true north; clocks are counted from the own
one, which nothing ties to the true time.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from estimation.frames import Site, target_from_source, wrap_pi
from fusion_center.navigation import site
from schemas.messages import (
    AlignedCarrier,
    Alignment,
    DeclaredScenario,
    Navigation,
    TruthCarriers,
    TruthScenario,
)
from sim_world.scenario import parse_scenario
from sim_world.scenario.declared import beacon_place_m

from .frames import place_at, reported_at, symmetric

Told = Alignment | TruthCarriers | Navigation
NAN = float("nan")


class AlignmentError(NamedTuple):
    """What one alignment tells of one carrier, against the truth.

    Attributes:
        reported_m, found_m: (east, north) error of the place by the carrier's own navigation,
            and by the alignment; sigma_m: claimed along both axes.
        nees: of the place, two degrees of freedom; nan where it is claimed to be known.
        reported_rad, found_rad: error of its own north; sigma_rad: 0 where it is declared known.
        reported_s, found_s: error of its clock against the own one; sigma_s: likewise.
    """

    t_ns: int
    reported_m: tuple[float, float]
    found_m: tuple[float, float]
    sigma_m: tuple[float, float]
    nees: float
    reported_rad: float
    found_rad: float
    sigma_rad: float
    reported_s: float
    found_s: float
    sigma_s: float


class AlignmentSummary(Struct, frozen=True, kw_only=True):
    """Of one carrier, root mean squares over the second half of the run.

    Attributes:
        status, unobservable, ranges: as told last.
        nees_per_dimension: of the place; 1 where its covariance is honest.
    """

    carrier: str
    status: str
    ranges: int
    unobservable: list[str]
    alignments: int
    reported_m: float
    found_m: float
    sigma_m: float
    nees_per_dimension: float
    reported_rad: float
    found_rad: float
    sigma_rad: float
    reported_s: float
    found_s: float
    sigma_s: float


class BeaconSummary(Struct, frozen=True, kw_only=True):
    """Where a beacon was told to be at the end, against the truth.

    Attributes:
        declared_m, found_m: error (3-D distance) of its place as declared, and as found; nan where
            the truth is not known.
        sigma_m: claimed, root of the summed variances.
        unobservable: what ranges leave open of it.
    """

    beacon: str
    declared_m: float
    found_m: float
    sigma_m: float
    unobservable: list[str]


def alignment_errors(
    scenario: DeclaredScenario, own: str, messages: Iterable[Told]
) -> dict[str, list[AlignmentError]]:
    """Error of everything that alignments tell of carriers in the truth, by carrier, in order."""
    truths: list[TruthCarriers] = []
    navigation: dict[str, list[Navigation]] = defaultdict(list)
    told: list[Alignment] = []
    for message in messages:
        if isinstance(message, TruthCarriers):
            truths.append(message)
        elif isinstance(message, Navigation):
            navigation[message.carrier].append(message)
        else:
            told.append(message)
    truths.sort(key=_time)
    for said in navigation.values():
        said.sort(key=_time)
    errors: dict[str, list[AlignmentError]] = defaultdict(list)
    compared = _Compared(scenario, own, truths, navigation)
    for alignment in sorted(told, key=_time):
        for carrier in alignment.carriers:
            if (error := compared.error(carrier)) is not None:
                errors[carrier.carrier].append(error)
    return dict(errors)


class _Compared(NamedTuple):
    """The truth and the navigation of a run, by time."""

    scenario: DeclaredScenario
    own: str
    truths: Sequence[TruthCarriers]
    navigation: Mapping[str, Sequence[Navigation]]

    def error(self, told: AlignedCarrier) -> AlignmentError | None:
        """None where the truth knows nothing of the carrier."""
        before = bisect_right(self.truths, told.t_ns, key=_time)
        truth = self.truths[max(0, before - 1)] if self.truths else None
        if truth is None or told.carrier not in truth.carrier:
            return None
        index = truth.carrier.index(told.carrier)
        true_m = place_at(truth, index, told.t_ns)[:2]
        found_m = np.array(told.position_m) - true_m
        covariance = symmetric(told.covariance)
        known = covariance[0, 0] <= 0 or covariance[1, 1] <= 0
        north = truth.north_error_rad[index] if truth.north_error_rad else 0.0
        late_s = _clock_s(truth, told.carrier) - _clock_s(truth, self.own)
        return AlignmentError(
            t_ns=told.t_ns,
            reported_m=_pair(self._reported_m(told) - true_m),
            found_m=_pair(found_m),
            sigma_m=_pair(np.sqrt(np.diag(covariance))),
            nees=NAN if known else float(found_m @ np.linalg.solve(covariance, found_m)),
            reported_rad=-north,
            found_rad=float(wrap_pi(told.north_rad - north)),
            sigma_rad=told.sigma_north_rad,
            reported_s=-late_s,
            found_s=told.stamp_s - late_s,
            sigma_s=told.sigma_stamp_s,
        )

    def _reported_m(self, told: AlignedCarrier) -> np.ndarray:
        """Where its own navigation puts it (2,); nan before there is any."""
        pose = reported_at(self.navigation.get(told.carrier, ()), told.t_ns)
        if pose is None:
            return np.full(2, NAN)
        origin = self.scenario.origin
        here = Site(origin.latitude_rad, origin.longitude_rad, origin.altitude_m)
        place: np.ndarray = target_from_source(here, site(pose)).translation_m
        return place[:2]


def summarise_alignment(errors: Sequence[AlignmentError], last: AlignedCarrier) -> AlignmentSummary:
    """Root mean squares over the second half of the errors; nan where nothing is known.

    Args:
        last: what was told of the carrier last.
    """
    late = errors[len(errors) // 2 :]
    nees = [e.nees for e in late if np.isfinite(e.nees)]
    return AlignmentSummary(
        carrier=last.carrier,
        status=last.status,
        ranges=last.ranges,
        unobservable=list(last.unobservable),
        alignments=len(late),
        reported_m=_rms([e.reported_m for e in late]),
        found_m=_rms([e.found_m for e in late]),
        sigma_m=_rms([e.sigma_m for e in late]),
        nees_per_dimension=float(np.mean(nees)) / 2 if nees else NAN,
        reported_rad=_rms([(e.reported_rad,) for e in late]),
        found_rad=_rms([(e.found_rad,) for e in late]),
        sigma_rad=_rms([(e.sigma_rad,) for e in late]),
        reported_s=_rms([(e.reported_s,) for e in late]),
        found_s=_rms([(e.found_s,) for e in late]),
        sigma_s=_rms([(e.sigma_s,) for e in late]),
    )


def summarise_beacons(
    scenario: DeclaredScenario, last: Alignment, true_m: Mapping[str, np.ndarray]
) -> list[BeaconSummary]:
    """Every beacon of an alignment, but those whose place is declared to be known.

    Args:
        true_m: (3,) of each beacon whose place is known in truth, see `true_beacons_m`.
    """
    declared = {beacon.name: beacon for beacon in scenario.beacons}
    here = Site(*(getattr(scenario.origin, name) for name in scenario.origin.__struct_fields__))
    summaries = []
    for told in last.beacons:
        if not any(told.covariance):
            continue
        before, true = declared[told.beacon], true_m.get(told.beacon, np.full(3, NAN))
        there = Site(before.latitude_rad, before.longitude_rad, before.altitude_m)
        found = np.array(told.position_m)
        summaries.append(BeaconSummary(
            beacon=told.beacon,
            declared_m=_length(target_from_source(here, there).translation_m - true),
            found_m=_length(found - true[: len(found)]),
            sigma_m=float(np.sqrt(np.trace(symmetric(told.covariance)))),
            unobservable=list(told.unobservable),
        ))  # fmt: skip
    return summaries


def true_beacons_m(truth: TruthScenario | None) -> dict[str, np.ndarray]:
    """Where beacons truly are (3,) by the truth part of a scenario; none where it is not known."""
    if truth is None or not truth.text:
        return {}
    file = parse_scenario(truth.text).file
    return {beacon.name: beacon_place_m(file, beacon) for beacon in file.beacons}


def _length(vector: np.ndarray) -> float:
    return float(np.linalg.norm(vector))


def _clock_s(truth: TruthCarriers, carrier: str) -> float:
    if not truth.clock_offset_s or carrier not in truth.carrier:
        return 0.0
    return truth.clock_offset_s[truth.carrier.index(carrier)]


def _time(message: Told) -> int:
    return message.t_ns


def _pair(vector: np.ndarray) -> tuple[float, float]:
    return float(vector[0]), float(vector[1])


def _rms(vectors: Sequence[Sequence[float]]) -> float:
    """Of vectors (n, d), those that are known."""
    known = [v for v in vectors if np.isfinite(v).all()]
    return float(np.sqrt(np.mean(np.sum(np.square(known), axis=1)))) if known else NAN
