"""All targets of a scenario, from single ones, random groups and recorded tracks."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from typing import NamedTuple

import numpy as np

from estimation.frames import Site
from schemas.errors import ScenarioError

from .motion import Path, path_of
from .noise import generator, stable_hash
from .scenario import Scenario
from .scenario.checks import feature_names, word_names
from .scenario.file import ScenarioFile, Target, TargetGroup, Tracks
from .scenario.motions import ConstantVelocity, CoordinatedTurn, Track, TrackFile
from .tracks_csv import Recording, Report, read_reports, recordings

Recorded = tuple[Recording, TrackFile]


class TargetPlan(NamedTuple):
    """One target: who it is, when it is there and how it moves.

    Attributes:
        number: stable name of its random draws; the same whatever other targets there are.
        features: in the order of `feature_names`; words: of `word_names`, empty = none.
    """

    name: str
    number: int
    class_name: str
    identity: str
    features: tuple[float, ...]
    words: tuple[str, ...]
    motion: Path | Recorded
    start_s: float = 0.0
    end_s: float = inf


def plan_targets(scenario: Scenario, origin: Site) -> list[TargetPlan]:
    """Every target of a scenario; those that move along paths come first.

    Raises:
        ScenarioError: a recorded track cannot be had.
    """
    files = _Files(scenario, origin)
    plans = [
        *_singles(scenario.file, files),
        *(plan for group in scenario.file.target_groups for plan in _group(scenario.file, group)),
        *(plan for n in range(len(scenario.file.tracks)) for plan in _tracks(scenario, n, files)),
    ]
    return _numbered(sorted(plans, key=lambda plan: not isinstance(plan.motion, Path)))


def _numbered(plans: list[TargetPlan]) -> list[TargetPlan]:
    """Numbers from names; two names that share a hash are told apart by hashing again."""
    taken, numbered = set[int](), []
    for plan in plans:
        salt = plan.name
        while (number := stable_hash(salt, bits=32)) in taken:
            salt += "+"
        taken.add(number)
        numbered.append(plan._replace(number=number))
    return numbered


def _plan(file: ScenarioFile, target: Target, motion: Path | Recorded) -> TargetPlan:
    return TargetPlan(
        name=target.name,
        number=0,
        class_name=target.class_name,
        identity=target.identity,
        features=_features(file, target),
        words=_words(file, target),
        motion=motion,
        start_s=target.start_s,
        end_s=target.end_s,
    )


def _features(file: ScenarioFile, target: Target) -> tuple[float, ...]:
    """What the target says itself, else a draw from its class."""
    classes = {c.name: c.features for c in file.classes}
    values = []
    for name in feature_names(file):
        if name in target.features:
            values.append(target.features[name])
        else:
            mean, sigma = classes[target.class_name][name]
            draw = generator(file.seed, "target", target.name, name).standard_normal()
            values.append(mean + sigma * float(draw))
    return tuple(values)


def _words(file: ScenarioFile, target: Target) -> tuple[str, ...]:
    """What the target says itself, else a draw from its class; empty of a class without."""
    weights = {c.name: c.words for c in file.classes}.get(target.class_name, {})
    words = []
    for name in word_names(file):
        word = target.words.get(name, "")
        if not word and weights.get(name):
            word = _choice(weights[name], generator(file.seed, "target", target.name, name))
        words.append(word)
    return tuple(words)


def _singles(file: ScenarioFile, files: _Files) -> Iterator[TargetPlan]:
    for n, target in enumerate(file.targets):
        if isinstance(target.motion, Track):
            yield _plan(file, target, files.track(target.motion, "targets", n, "motion"))
        else:
            yield _plan(file, target, path_of(target.motion))


def _group(file: ScenarioFile, group: TargetGroup) -> Iterator[TargetPlan]:
    """Members by number, each from a generator of its own: more of them change no other."""
    for n in range(group.count):
        name = f"{group.name}-{n:04d}"
        rng = generator(file.seed, "target", name)
        motion = _random_motion(group, rng)
        identity = name if rng.random() < group.identity_share else ""
        target = Target(
            name=name,
            class_name=_choice(group.classes, rng) if group.classes else "",
            identity=identity,
            start_s=group.start_s,
            end_s=group.end_s,
            motion=motion,
        )
        yield _plan(file, target, path_of(motion))


def _random_motion(
    group: TargetGroup, rng: np.random.Generator
) -> ConstantVelocity | CoordinatedTurn:
    kind = _choice(group.motions or {"constant_velocity": 1.0}, rng)
    west, east, south, north = group.box_m
    start = ConstantVelocity(
        east_m=rng.uniform(west, east),
        north_m=rng.uniform(south, north),
        course_deg=rng.uniform(*group.course_deg),
        speed_mps=rng.uniform(*group.speed_mps),
        altitude_m=rng.uniform(*group.altitude_m),
    )
    rate = rng.uniform(*group.turn_rate_deg_s)
    if kind == "constant_velocity":
        return start
    return CoordinatedTurn(
        east_m=start.east_m,
        north_m=start.north_m,
        course_deg=start.course_deg,
        speed_mps=start.speed_mps,
        altitude_m=start.altitude_m,
        turn_rate_deg_s=rate,
    )


def _choice(weights: dict[str, float], rng: np.random.Generator) -> str:
    shares = np.array(list(weights.values()))
    return list(weights)[int(rng.choice(len(weights), p=shares / shares.sum()))]


def _tracks(scenario: Scenario, index: int, files: _Files) -> Iterator[TargetPlan]:
    tracks = scenario.file.tracks[index]
    for recording in files.all(tracks, "tracks", index):
        target = Target(
            name=f"{tracks.name}-{recording.id}",
            class_name=tracks.class_name,
            identity=recording.id,
            motion=ConstantVelocity(east_m=0.0, north_m=0.0),
        )
        yield _plan(scenario.file, target, (recording, tracks))


class _Files:
    """Files of tracks, each read once."""

    def __init__(self, scenario: Scenario, origin: Site) -> None:
        self.scenario, self.origin = scenario, origin
        self._reports: dict[tuple[str, object], list[Report]] = {}

    def all(self, tracks: Tracks, *path: str | int) -> Iterator[Recording]:
        """Every track of a file that is asked for, by id."""
        wanted = {str(name) for name in tracks.ids}
        reports = self._read(tracks, *path)
        chosen = [r for r in reports if r.id in wanted] if wanted else reports
        self._require(wanted - {r.id for r in reports}, tracks, reports)
        yield from recordings(chosen, tracks, self.origin, tracks.min_reports)

    def track(self, track: Track, *path: str | int) -> Recorded:
        """One track of a file."""
        reports = self._read(track, *path)
        chosen = [r for r in reports if r.id == str(track.id)]
        found = list(recordings(chosen, track, self.origin))
        self._require(set() if found else {str(track.id)}, track, reports)
        return found[0], track

    def _read(self, tracks: TrackFile, *path: str | int) -> list[Report]:
        key = (tracks.file, tracks.columns)
        if key not in self._reports:
            found = self.scenario.data_file(tracks.file, *path, "file")
            self._reports[key] = read_reports(found, tracks.columns)
        return self._reports[key]

    def _require(self, missing: set[str], tracks: TrackFile, reports: list[Report]) -> None:
        if missing:
            some = ", ".join(sorted({r.id for r in reports})[:5])
            raise ScenarioError(
                "no such track, or fewer than two reports of it",
                where=f"{self.scenario.where}: {tracks.file}",
                got=", ".join(sorted(missing)),
                expected=f"one of {some}, ...",
            )
