"""What no single key can say: names that clash or are missing, keys that contradict each other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from math import atan2, cos, hypot, radians
from typing import Any, NamedTuple

from schemas.errors import ScenarioError
from schemas.keys import RESERVED_PROCESSES, RESERVED_STREAMS

from .declared import CLASS_FEATURE
from .file import EARLIEST, Carrier, NavigationPrior, ScenarioFile, Sensor, TargetGroup
from .motions import AnyMotion, ConstantAcceleration, CoordinatedTurn, TrackFile, Waypoints
from .ranging import Ranging
from .validation import key_of, nearest

Path = tuple[str | int, ...]
GROUP_MOTIONS = ("constant_velocity", "coordinated_turn")
UNLIMITED_M = 1e9
SHARPEST_COSINE = cos(radians(170))


class Problem(NamedTuple):
    """What is wrong at a place of the file, what stands there and what should."""

    path: Path
    what: str
    got: object
    expected: str


def check(file: ScenarioFile, tree: dict[str, Any], where: str) -> None:
    """Refuse a file whose keys are valid one by one but not together.

    Raises:
        ScenarioError: the first contradiction found.
    """
    for problem in _problems(file):
        raise ScenarioError(
            problem.what,
            where=f"{where}: {_key(tree, problem.path)}",
            got=problem.got,
            expected=problem.expected,
        )


def _key(tree: dict[str, Any], path: Path) -> str:
    """The dotted key, also where its last part is absent and a default stands for it."""
    inner = ".".join(filter(None, (key_of(tree, *path[:-1]), str(path[-1]))))
    return inner if isinstance(path[-1], str) else key_of(tree, *path)


def _problems(file: ScenarioFile) -> Iterator[Problem]:
    yield from _time(file)
    yield from _names(file)
    for n, carrier in enumerate(file.carriers):
        yield from _carrier(file, carrier, ("carriers", n))
        if carrier.use_corrections and carrier.name == _own(file):
            expected = "false: corrections lead to the frame of this very carrier, see fusion.own"
            yield Problem(("carriers", n, "use_corrections"), "of the own carrier", True, expected)
    yield from _targets(file)
    for n, group in enumerate(file.target_groups):
        yield from _group(file, group, ("target_groups", n))
    for n, tracks in enumerate(file.tracks):
        yield from _class(file, tracks.class_name, ("tracks", n, "class"))
        yield from _columns(tracks, ("tracks", n))


def _time(file: ScenarioFile) -> Iterator[Problem]:
    if file.time.epoch < EARLIEST:
        yield Problem(("time", "epoch"), "too early", str(file.time.epoch), "1970 or later")
    if file.time.duration_s < file.time.step_s:
        expected = f">= step_s ({file.time.step_s:g})"
        yield Problem(("time", "duration_s"), "shorter than a step", file.time.duration_s, expected)


def _own(file: ScenarioFile) -> object:
    """The carrier whose frame is the gauge; the fusion centre sees to it that there is one."""
    return file.fusion.get("own") or next((carrier.name for carrier in file.carriers), "")


def _names(file: ScenarioFile) -> Iterator[Problem]:
    yield from _unique(("carriers",), [c.name for c in file.carriers])
    yield from _unique(("classes",), [c.name for c in file.classes])
    yield from _unique(("targets",), [t.name for t in file.targets])
    yield from _unique(("target_groups",), [t.name for t in file.target_groups])
    yield from _unique(("tracks",), [t.name for t in file.tracks])
    yield from _unique(("targets",), [t.identity for t in file.targets], "identity")
    carriers = [c.name for c in file.carriers]
    yield from _unique(("beacons",), [b.name for b in file.beacons])
    for n, beacon in enumerate(file.beacons):
        if beacon.name in carriers:
            yield Problem(("beacons", n, "name"), "a carrier's", beacon.name, "a name of its own")
    own = file.fusion.get("own", carriers[0])
    if own not in carriers:
        yield Problem(("fusion", "own"), "no such carrier", own, nearest(str(own), carriers))


def _unique(path: Path, names: list[str], key: str = "name") -> Iterator[Problem]:
    """Each name once; absent ones (empty) do not count."""
    for n, name in enumerate(names):
        if name and name in names[:n]:
            yield Problem((*path, n, key), "given twice", name, "a name of its own")


def _clock(file: ScenarioFile, navigation: NavigationPrior, path: Path) -> Iterator[Problem]:
    """A clock that no message is late by, at the start and at the end."""
    limit = file.time.max_clock_error_s
    expected = f"<= {limit / 3:g}, a third of time.max_clock_error_s, or its messages are late"
    start = navigation.sigma_clock_s
    if 3 * start > limit:
        yield Problem((*path, "sigma_clock_s"), "too large", start, expected)
    end = hypot(start, navigation.sigma_clock_drift_ppm * 1e-6 * file.time.duration_s)
    if 3 * start <= limit < 3 * end:
        gained = f"{end:.3g} s at the end of the run"
        yield Problem((*path, "sigma_clock_drift_ppm"), "too large", gained, expected)


def _carrier(file: ScenarioFile, carrier: Carrier, path: Path) -> Iterator[Problem]:
    yield from _reserved(carrier.name, RESERVED_PROCESSES, path)
    yield from _unique((*path, "sensors"), [s.name for s in carrier.sensors])
    yield from _way(carrier.motion, (*path, "motion"))
    yield from _clock(file, carrier.navigation, (*path, "navigation"))
    for n, sensor in enumerate(carrier.sensors):
        inner = (*path, "sensors", n)
        yield from _reserved(sensor.name, RESERVED_STREAMS, inner)
        yield from _coordinates(sensor, inner)
        yield from _limits(sensor, inner)
        yield from _descriptions(file, sensor, inner)
    yield from _unique((*path, "ranging"), [table.kind for table in carrier.ranging], "kind")
    for n, table in enumerate(carrier.ranging):
        yield from _ranging(file, carrier, table, (*path, "ranging", n))


def _ranging(file: ScenarioFile, carrier: Carrier, table: Ranging, path: Path) -> Iterator[Problem]:
    """Whom it ranges to must be there, each once, and a difference needs two."""
    others = [c.name for c in file.carriers if c.name != carrier.name]
    known = [*(b.name for b in file.beacons), *others]
    for n, name in enumerate(table.to):
        if name not in known:
            yield Problem((*path, "to"), "no beacon or other carrier", name, nearest(name, known))
        elif name in table.to[:n]:
            yield Problem((*path, "to"), "given twice", name, "each peer once")
    if table.kind == "difference" and len(table.to) < 2:
        yield Problem((*path, "to"), "no difference", table.to, "a reference and another peer")
    if table.outlier_m[0] > table.outlier_m[1]:
        yield Problem((*path, "outlier_m"), "upside down", list(table.outlier_m), "[least, most]")
    clock = table.sigma_clock_m or table.sigma_clock_drift_mps
    if table.kind != "pseudorange" and clock:
        yield Problem((*path, "sigma_clock_m"), "it has no clock in it", clock, "no such key")


def _reserved(name: str, reserved: Iterable[str], path: Path) -> Iterator[Problem]:
    if name in reserved:
        yield Problem((*path, "name"), "reserved", name, "another than " + ", ".join(reserved))


def _coordinates(sensor: Sensor, path: Path) -> Iterator[Problem]:
    """Sigmas must be of the coordinates that the sensor measures."""
    if sensor.coordinates == "bearing_range" and sensor.sigma_range_m is None:
        yield Problem((*path, "sigma_range_m"), "missing key", None, "a sigma of its ranges")
    if sensor.tracking and sensor.coordinates == "bearing":
        inner = (*path, "coordinates")
        yield Problem(inner, "tracks need ranges", sensor.coordinates, "bearing_range")
    if sensor.coordinates == "bearing":
        for key in (
            "sigma_range_m", "sigma_range_bias_m", "sigma_range_scale", "resolution_range_m",
        ):  # fmt: skip
            if value := getattr(sensor, key):
                yield Problem((*path, key), "it measures no range", value, "no such key")


def _limits(sensor: Sensor, path: Path) -> Iterator[Problem]:
    if sensor.range_min_m >= sensor.range_max_m:
        expected = f"> range_min_m ({sensor.range_min_m:g})"
        yield Problem((*path, "range_max_m"), "sees nothing", sensor.range_max_m, expected)
    ranging = sensor.coordinates == "bearing_range"
    if ranging and sensor.clutter_per_scan and sensor.range_max_m >= UNLIMITED_M:
        yield Problem(
            (*path, "range_max_m"), "missing key", None, "a limit, false alarms fill its area"
        )


def _descriptions(file: ScenarioFile, sensor: Sensor, path: Path) -> Iterator[Problem]:
    """Features and classes a sensor tells must be ones that targets have."""
    known = feature_names(file)
    yield from _unique((*path, "features"), [f.name for f in sensor.features])
    yield from _words(file, sensor, path)
    for n, feature in enumerate(sensor.features):
        key = (*path, "features", n, "name")
        yield from _reserved(feature.name, (CLASS_FEATURE,), key[:-1])
        if feature.name not in known:
            yield Problem(key, "no target has it", feature.name, nearest(feature.name, known))
        if feature.population:
            yield from _ordered(feature.population, (*path, "features", n, "population"))
    if sensor.classes and not file.classes:
        yield Problem((*path, "classes"), "there are no classes", None, "[[classes]] in the file")


def _targets(file: ScenarioFile) -> Iterator[Problem]:
    for n, target in enumerate(file.targets):
        path: Path = ("targets", n)
        yield from _class(file, target.class_name, (*path, "class"), target.features)
        yield from _way(target.motion, (*path, "motion"))
        if isinstance(target.motion, TrackFile):
            yield from _columns(target.motion, (*path, "motion"))
        if target.end_s <= target.start_s:
            yield Problem((*path, "end_s"), "never there", target.end_s, f"> {target.start_s:g}")
        for name in target.features.keys() - set(feature_names(file)):
            yield Problem((*path, "features", name), "unknown", name, "a feature of a class")


def _words(file: ScenarioFile, sensor: Sensor, path: Path) -> Iterator[Problem]:
    """Words a sensor tells must be ones that targets have, each under a name of its own."""
    known, numbers = word_names(file), [f.name for f in sensor.features]
    for n, word in enumerate(sensor.words):
        key = (*path, "words", n, "name")
        yield from _reserved(word.name, (CLASS_FEATURE,), key[:-1])
        if word.name not in known:
            yield Problem(key, "no target has it", word.name, nearest(word.name, known or [""]))
        if word.name in [*numbers, *(w.name for w in sensor.words[:n])]:
            yield Problem(key, "given twice", word.name, "a name of its own")
        said = {w for t in file.targets for w in [t.words.get(word.name)] if w}
        said |= {w for c in file.classes for w in c.words.get(word.name, ())}
        for name in sorted(said - set(word.categories)):
            yield Problem((*path, "words", n, "categories"), "one is missing", name, "all words")


def _class(
    file: ScenarioFile, name: str, path: Path, given: Iterable[str] = ()
) -> Iterator[Problem]:
    """A class must be there and, with what the target gives itself, have every feature."""
    classes = {c.name: c for c in file.classes}
    if name and name not in classes:
        known = list(classes) or ["those in [[classes]], where there are none"]
        yield Problem(path, "no such class", name, nearest(name, known))
        return
    has = {*given, *(classes[name].features if name else ())}
    for feature in feature_names(file):
        if feature not in has:
            yield Problem(
                path, f"no feature {feature}", name, f"a class with it, or features.{feature}"
            )


def feature_names(file: ScenarioFile) -> list[str]:
    """The features of targets; every target has all of them."""
    of_classes = [name for c in file.classes for name in c.features]
    return sorted({*of_classes, *(name for t in file.targets for name in t.features)})


def word_names(file: ScenarioFile) -> list[str]:
    """The words of targets; one that has none is not told."""
    of_classes = [name for c in file.classes for name in c.words]
    return sorted({*of_classes, *(name for t in file.targets for name in t.words)})


def _group(file: ScenarioFile, group: TargetGroup, path: Path) -> Iterator[Problem]:
    for name in group.classes or {"": 1.0}:
        yield from _class(file, name, (*path, "classes"))
    for name in group.motions:
        if name not in GROUP_MOTIONS:
            expected = nearest(name, GROUP_MOTIONS)
            yield Problem((*path, "motions"), "no motion of a group", name, expected)
    for key in ("classes", "motions"):
        weights = getattr(group, key)
        if weights and not sum(weights.values()):
            yield Problem((*path, key), "all weights are 0", weights, "one above 0")
    yield from _ordered(group.box_m[:2], (*path, "box_m"))
    yield from _ordered(group.box_m[2:], (*path, "box_m"))
    for key in ("course_deg", "speed_mps", "altitude_m", "turn_rate_deg_s"):
        yield from _ordered(getattr(group, key), (*path, key))
    if group.speed_mps[0] < 0:
        yield Problem((*path, "speed_mps"), "negative", group.speed_mps, ">= 0")
    if group.end_s <= group.start_s:
        yield Problem((*path, "end_s"), "never there", group.end_s, f"> {group.start_s:g}")


def _ordered(interval: tuple[float, ...], path: Path) -> Iterator[Problem]:
    if interval[0] > interval[1]:
        yield Problem(path, "upside down", list(interval), "[least, greatest]")


def _way(motion: AnyMotion, path: Path) -> Iterator[Problem]:
    """Motions that contradict themselves."""
    match motion:
        case Waypoints():
            yield from _line(motion, (*path, "points_m"))
        case CoordinatedTurn(from_s=start, until_s=end) if end <= start:
            yield Problem((*path, "until_s"), "never turns", end, f"> from_s ({start:g})")
        case ConstantAcceleration(speed_limit_mps=limit) if limit is not None:
            if motion.acceleration_mps2 * (limit - motion.speed_mps) < 0:
                expected = f"one that {motion.speed_mps:g} m/s is led to"
                yield Problem((*path, "speed_limit_mps"), "never reached", limit, expected)


def _line(motion: Waypoints, path: Path) -> Iterator[Problem]:
    """Every leg must lead somewhere, and none straight back where it came from."""
    points = motion.points_m + (motion.points_m[:2] if motion.closed else [])
    if motion.closed and len(motion.points_m) < 3:
        yield Problem(path, "no loop", len(motion.points_m), "3 points or more")
        return
    if any(a == b for a, b in pairwise(points)):
        yield Problem(path, "the same point twice running", motion.points_m, "legs")
        return
    courses = [atan2(e - e0, n - n0) for (e0, n0), (e, n) in pairwise(points)]
    for corner, (before, after) in enumerate(pairwise(courses), start=1):
        if cos(after - before) < SHARPEST_COSINE:
            got = list(points[corner])
            yield Problem(path, "turns back on itself", got, "a turn of less than 170 degrees")


def _columns(tracks: TrackFile, path: Path) -> Iterator[Problem]:
    columns = tracks.columns
    if columns.speed_mps and columns.speed_knots:
        key = (*path, "columns", "speed_knots")
        yield Problem(key, "speed given twice", columns.speed_knots, "this or speed_mps")
    speed = columns.speed_mps or columns.speed_knots
    if bool(speed) != bool(columns.course_deg):
        got = speed or columns.course_deg
        expected = "speed and course_deg, or neither"
        yield Problem((*path, "columns", "course_deg"), "half a velocity", got, expected)
