"""Stone Soup on a recording: its detections are our target logs, its tracks get our marks.

    pip install 'crossfix[bench]'
    python examples/stonesoup_tracking.py recordings/strait.mcap

It tracks what one carrier (default: the own one) saw, in the picture's axes as that carrier
believes them, with a plain Stone Soup tracker: Kalman filters, global nearest neighbour. Take it
from there: `detections` is all that a tracker of yours needs, and `marks` what judges it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.frames import (
    Site,
    on_surface,
    rotation_clockwise,
    site_at,
    target_from_source,
)
from estimation.metrics import Gospa, Picture, Siap, gospa_over_time, siap
from fusion_center.navigation import pose_at, with_message
from fusion_center.sources.coordinates import Observer, places
from schemas import keys
from schemas.messages import (
    Navigation,
    SourceInfo,
    SourceProperties,
    SourceReport,
    TruthCarriers,
    TruthTargets,
)
from schemas.recording.reader import Recording, open_recording

CUT_OFF_M = 1000.0  # of GOSPA
Q = 0.05  # m^2/s^3, of targets that hold their course
MISSED_SIGMAS = 4.0  # from where a detection is rather of another target
STEPS_TO_START, SECONDS_TO_END = 3, 15.0


class Scan(NamedTuple):
    """One report: places (n, 2) east and north in the picture's axes, and their covariances."""

    t_ns: int
    place_m: Array
    covariance: Array


class Scene(NamedTuple):
    """What a carrier saw, and where the targets were as it would have seen them without noise."""

    scans: list[Scan]
    truth: Picture


class Marks(NamedTuple):
    """Our metrics of a picture: GOSPA of every scan, and SIAP of the run."""

    gospa: Gospa
    siap: Siap


def read(path: str, carrier: str = "") -> Scene:
    """The reports of one carrier of a recording (default: the first), and the truth."""
    with open_recording(path) as recording:
        name = carrier or recording.scenario.carriers[0].name
        topics = (keys.SOURCE, keys.NAVIGATION, keys.REPORT)
        said = [m.decode() for m in recording.messages(topics=topics, order="log_time")]
        own = [m for m in said if getattr(m, "carrier", "") == name]
        origin = Site(
            recording.scenario.origin.latitude_rad,
            recording.scenario.origin.longitude_rad,
            recording.scenario.origin.altitude_m,
        )
        scans = list(_scans(own, origin))
        return Scene(scans, _truth(recording, own, origin, name, [scan.t_ns for scan in scans]))


def _scans(said: Iterable[object], origin: Site) -> Iterator[Scan]:
    """Every report with a target in it, by time, where the carrier believes to have been."""
    navigation: tuple[Navigation, ...] = ()
    properties: dict[str, SourceProperties] = {}
    for message in sorted(said, key=_order):
        if isinstance(message, Navigation):
            navigation = with_message(navigation, message)
        elif isinstance(message, SourceInfo):
            properties[message.source] = message.properties
        elif isinstance(message, SourceReport) and navigation and len(message):
            site = _reported_site(navigation, message.t_ns)
            still = np.zeros((len(message), 2))
            found = places(message, properties[message.stream], Observer(site, still), 0.0)
            known = found.usable
            level = _in_picture(origin, site, found.east_north_m[known])
            yield Scan(message.t_ns, level, found.covariance[known])


def _order(message: object) -> tuple[int, int]:
    """By stamp; what a report needs goes before it."""
    first = 0 if isinstance(message, SourceInfo) else 1 if isinstance(message, Navigation) else 2
    return (0 if first == 0 else getattr(message, "t_ns", 0), first)


def _reported_site(navigation: tuple[Navigation, ...], t_ns: int) -> Site:
    pose = pose_at(navigation, t_ns)
    return Site(pose.latitude_rad, pose.longitude_rad, pose.altitude_m)


def _in_picture(origin: Site, site: Site, east_north_m: Array) -> Array:
    """Places (n, 2) on the surface round a site, in the axes at the origin."""
    points = on_surface(site, east_north_m[:, 0], east_north_m[:, 1])
    level: Array = target_from_source(origin, site).apply(points)[:, :2]
    return level


def _truth(
    recording: Recording, own: Iterable[object], origin: Site, name: str, times_ns: list[int]
) -> Picture:
    """The true targets at each scan, moved and turned as the carrier's own errors have it."""
    carriers, targets = (
        {m.t_ns: m for recorded in recording.messages(topics=(t,)) for m in [recorded.decode()]}
        for t in (keys.TRUTH_CARRIERS, keys.TRUTH_TARGETS)
    )
    navigation = [m for m in own if isinstance(m, Navigation)]
    stamps = np.array(sorted(targets.keys() & carriers.keys()))
    steps, numbers, level = [], [], [np.empty((0, 2))]
    for t_ns in sorted(set(times_ns)):
        stamp = int(stamps[max(int(np.searchsorted(stamps, t_ns, side="right")) - 1, 0)])
        believed = _reported_site(_last_two(navigation, t_ns), t_ns)
        level.append(_believed(targets[stamp], carriers[stamp], name, origin, believed, t_ns))
        numbers += targets[stamp].number
        steps += [t_ns] * len(targets[stamp].number)
    return Picture(np.array(steps, dtype=np.int64), np.array(numbers), np.concatenate(level))


def _last_two(navigation: list[Navigation], t_ns: int) -> tuple[Navigation, ...]:
    """What a carrier had said of itself by an instant; its first word before that."""
    said = sorted(navigation, key=lambda message: message.t_ns)
    return tuple([m for m in said if m.t_ns <= t_ns][-2:] or said[:1])


def _believed(
    targets: TruthTargets,
    carriers: TruthCarriers,
    name: str,
    origin: Site,
    believed: Site,
    t_ns: int,
) -> Array:
    """Targets (n, 2) as a carrier without noise would place them."""
    passed_s = (t_ns - targets.t_ns) * 1e-9
    index = carriers.carrier.index(name)
    own = np.array(carriers.position_m[index]) + passed_s * np.array(carriers.velocity_mps[index])
    place = np.reshape(targets.position_m, (-1, 3))
    place = place + passed_s * np.reshape(targets.velocity_mps, (-1, 3))
    seen = target_from_source(site_at(origin, own), origin).apply(place)[:, :2]
    turn = rotation_clockwise(-np.array(carriers.north_error_rad[index]))
    return _in_picture(origin, believed, seen @ turn.T)


def detections(scans: Iterable[Scan]) -> Iterator[tuple[datetime, set[Any]]]:
    """Stone Soup's detections, scan by scan: state (east, its rate, north, its rate)."""
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.types.detection import Detection

    for scan in scans:
        when = _datetime(scan.t_ns)
        yield (
            when,
            {
                Detection(
                    place[:, None],
                    timestamp=when,
                    measurement_model=LinearGaussian(4, (0, 2), covariance),
                )
                for place, covariance in zip(scan.place_m, scan.covariance, strict=True)
            },
        )


def tracked(scans: list[Scan]) -> Picture:
    """Stone Soup's tracks of all scans, as columns for our metrics."""
    numbers: dict[str, int] = {}
    steps, identities, level = [], [], []
    for scan, (_, tracks) in zip(scans, _tracker(scans), strict=True):
        for track in sorted(tracks, key=lambda track: str(track.id)):
            steps.append(scan.t_ns)
            identities.append(numbers.setdefault(track.id, len(numbers)))
            level.append(np.asarray(track.state_vector, dtype=float)[[0, 2], 0])
    places_m = np.reshape(np.array(level, dtype=float), (-1, 2))
    return Picture(np.array(steps, dtype=np.int64), np.array(identities, dtype=int), places_m)


def _tracker(scans: list[Scan]) -> Any:
    """The tracker of Stone Soup's tutorials: Kalman, global nearest neighbour, m of n starts."""
    from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
    from stonesoup.deleter.time import UpdateTimeDeleter
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.initiator.simple import MultiMeasurementInitiator
    from stonesoup.measures import Mahalanobis
    from stonesoup.models.transition.linear import (
        CombinedLinearGaussianTransitionModel,
        ConstantVelocity,
    )
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.tracker.simple import MultiTargetTracker
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import KalmanUpdater

    predictor = KalmanPredictor(CombinedLinearGaussianTransitionModel([ConstantVelocity(Q)] * 2))
    updater = KalmanUpdater(None)
    hypotheses = DistanceHypothesiser(predictor, updater, Mahalanobis(), MISSED_SIGMAS)
    associator = GNNWith2DAssignment(hypotheses)
    deleter = UpdateTimeDeleter(timedelta(seconds=SECONDS_TO_END))
    prior = GaussianState(np.zeros((4, 1)), np.diag([0.0, 20.0**2, 0.0, 20.0**2]))
    starter = MultiMeasurementInitiator(
        prior, deleter, associator, updater, min_points=STEPS_TO_START
    )
    return MultiTargetTracker(starter, deleter, detections(scans), associator, updater)


def marks(truth: Picture, tracks: Picture) -> Marks:
    """Our metrics of the tracks, whoever made them."""
    return Marks(gospa_over_time(truth, tracks, CUT_OFF_M), siap(truth, tracks, CUT_OFF_M))


def _datetime(t_ns: int) -> datetime:
    return datetime.fromtimestamp(0, UTC).replace(tzinfo=None) + timedelta(microseconds=t_ns / 1e3)


def main() -> None:
    """Read, track, judge, print."""
    usage = "python examples/stonesoup_tracking.py RECORDING [--carrier NAME]"
    parser = argparse.ArgumentParser(description=__doc__, usage=usage)
    parser.add_argument("recording", help="of a simulated run, which holds the truth")
    parser.add_argument("--carrier", default="", help="whose reports to track (default: the own)")
    given = parser.parse_args()
    scene = read(given.recording, given.carrier)
    found = marks(scene.truth, tracked(scene.scans))
    late = slice(len(found.gospa.distance) // 2, None)
    print(f"{len(scene.scans)} scans, {sum(len(scan.place_m) for scan in scene.scans)} detections")
    print(f"GOSPA, second half: {found.gospa.distance[late].mean():.0f} m")
    print(f"missed {found.gospa.missed_count[late].mean():.2f} a scan, ", end="")
    print(f"false {found.gospa.false_count[late].mean():.2f}")
    print(
        f"completeness {found.siap.completeness:.3f}, ambiguity {found.siap.ambiguity:.3f}, ",
        end="",
    )
    print(f"spuriousness {found.siap.spuriousness:.3f}, accuracy {found.siap.accuracy:.0f} m")
    print(f"identity changes {found.siap.identity_changes}")


if __name__ == "__main__":
    main()
