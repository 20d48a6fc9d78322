"""Measure all that paper 002 demands of the tracker, print it.

Run `python -m bench.tracking [--scene FILE ...] [--peer stonesoup] [--seed N] [--runs N] [--json]`.
Without scene files, scenes are drawn; `--runs` 1 leaves the large ones out, 2 that of 100,000.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, Options, at_least, at_most, cpu_scale, options, report, told
from bench.tracking import arrival, ours, registered
from bench.tracking.ours import Run, settings_for
from bench.tracking.scenes import CARRIERS, FEATURES, Scene, Size, drawn, read, said
from bench.tracking.scoring import Score, score
from estimation.tracking.scan import Scan
from estimation.tracking.tracker import Settings

_LARGE_BOX_M = 316_228.0
_PEER_SCANS = 24  # of the larger scene: eight rounds of the carriers
_CONVERGED_S = 30.0


class Limits(NamedTuple):
    """What is demanded of a scene of some size."""

    cpu_ms: float
    gospa_m: float
    drawn_gospa_m: float
    times_faster: float


_LIMITS = {200: Limits(4.0, 900.0, 900.0, 100.0), 1000: Limits(10.0, 2150.0, 2100.0, 400.0)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--scene", type=Path, action="append", default=[])
    parser.add_argument("--peer", choices=["stonesoup"])
    ways, rest = parser.parse_known_args(arguments)
    given = options("Tracking in one picture (paper 002); --scene FILE, --peer stonesoup.", 3, rest)
    report(list(figures(given, ways.scene, ways.peer is not None)), given)


def figures(given: Options, files: Sequence[Path] = (), peer: bool = False) -> Iterator[Figure]:
    """Every demand on the tracker; of given scene files alone if there are any."""
    for path in files:
        scene = read(path)
        yield from scene_figures(path.stem, scene, peer, _limits(scene).gospa_m)
    if files:
        return
    for targets in _LIMITS:
        every = [drawn(_rng(given.seed, targets, k), Size(targets)) for k in range(given.runs)]
        name = f"{targets} targets"
        yield from scene_figures(name, every[0], peer, _limits(every[0]).drawn_gospa_m)
        yield from _fresh_figures(name, every[1:])
    if given.runs > 1:
        yield from large_figures(given)


def scene_figures(name: str, scene: Scene, peer: bool, gospa_m: float) -> Iterator[Figure]:
    """One scene of a size that has demands of its own."""
    limits, settings = _limits(scene), settings_for(scene)
    scans = ours.scans_of(scene, scene.pose)
    run, faster = _scaled(scene, settings)
    found = score(scene, run)
    yield at_most(f"{name}: CPU a scan, scaled", _ms(run) * faster, limits.cpu_ms, "ms")
    yield at_most(f"{name}: GOSPA, known frames", found.gospa_m, gospa_m, "m")
    yield from _parts(name, found)
    if scene.truth.shape[1] >= 1000:
        yield at_most(f"{name}: identity changes", found.identity_changes, 60)
        yield at_most(f"{name}: rmse of the number of targets", found.count_rmse, 0.008)
    else:
        yield told(f"{name}: identity changes", found.identity_changes)
        yield told(f"{name}: rmse of the number of targets", found.count_rmse)
    yield from _feature_figures(name, scene, run, limits.cpu_ms)
    yield from _registered_figures(name, scene, run, settings)
    late = arrival.cost(scans, settings, 1)
    yield at_least(f"{name}, scans 0 to 2 s late: same bits", late.identical, 1)
    yield at_most(f"{name}, scans 0 to 2 s late: CPU / in order", late.cpu, 1.4)
    yield told(f"{name}, scans 0 to 2 s late: steps / in order", late.steps)
    yield at_most(f"{name}, scans 0 to 2 s late: snapshots", late.memory_mib, 256, "MiB")
    if peer:
        yield from peer_figures(name, scene, limits.times_faster)


def peer_figures(name: str, scene: Scene, times: float) -> Iterator[Figure]:
    """Stone Soup on the first scans of the same scene, ours on them again right after."""
    from bench.tracking import peer

    scans = len(scene.t_s) if scene.truth.shape[1] <= 200 else _PEER_SCANS
    theirs = peer.run(scene, scene.pose, scans)
    mine = ours.run(ours.scans_of(scene, scene.pose)[:scans], settings_for(scene))
    after = slice(CARRIERS, None)  # the first round only begins tracks
    ratio = float(theirs.cpu_s[after].mean() / mine.cpu_s[after].mean())
    yield at_least(f"{name}, first {scans} scans: times faster than Stone Soup", ratio, times)
    yield told(f"{name}, first {scans} scans: Stone Soup, CPU a scan", _ms(theirs), "ms")
    yield told(f"{name}, first {scans} scans: Stone Soup, GOSPA", score(scene, theirs).gospa_m, "m")
    yield told(f"{name}, first {scans} scans: ours, GOSPA", score(scene, mine).gospa_m, "m")


def large_figures(given: Options) -> Iterator[Figure]:
    """Ten thousand at the same density, ten thousand dense with features, a hundred thousand."""
    scene = drawn(_rng(given.seed, 10_000, 0), Size(10_000, _LARGE_BOX_M))
    yield from _sized("10,000 in 316 km", scene, False, (100.0, 7200.0))
    scene = drawn(_rng(given.seed, 10_000, 1), Size(10_000))
    yield from _sized("dense 10,000 in 100 km, features", scene, True, (None, 8000.0))
    if given.runs > 2:
        scene = drawn(_rng(given.seed, 100_000, 0), Size(100_000, 1e6))
        yield from _sized("100,000 in 1000 km", scene, False, (900.0, 23_000.0))


def _sized(
    name: str, scene: Scene, features: bool, limits: tuple[float | None, float]
) -> Iterator[Figure]:
    settings = settings_for(scene)
    if features:
        settings = settings._replace(classes=(0.25,) * 4)
    run, faster = _scaled(scene, settings, features)
    found, cpu_ms = score(scene, run), _ms(run) * faster
    if limits[0] is None:
        yield told(f"{name}: CPU a scan, scaled", cpu_ms, "ms")
    else:
        yield at_most(f"{name}: CPU a scan, scaled", cpu_ms, limits[0], "ms")
    settled = float(np.median(run.cpu_s)) * 1e3 * faster
    yield told(f"{name}: CPU of the median scan, scaled", settled, "ms")
    yield at_most(f"{name}: GOSPA", found.gospa_m, limits[1], "m")
    yield from _parts(name, found)
    yield told(f"{name}: identity changes", found.identity_changes)


def _feature_figures(name: str, scene: Scene, plain: Run, cpu_ms: float) -> Iterator[Figure]:
    """The same scans with a number and a word at each plot."""
    settings = settings_for(scene)._replace(features=FEATURES)
    scans = [
        scan._replace(features=said(seen))
        for scan, seen in zip(ours.scans_of(scene, scene.pose), scene.seen, strict=True)
    ]
    before = cpu_scale()
    run = ours.run(scans, settings)
    faster, found = (before + cpu_scale()) / 2, score(scene, run)
    yield at_most(f"{name}, features: CPU a scan, scaled", _ms(run) * faster, cpu_ms, "ms")
    best = score(scene, plain).gospa_m
    yield at_most(f"{name}, features: GOSPA / without", found.gospa_m / best, 1.0)
    yield told(f"{name}, features: identity changes", found.identity_changes)


def _registered_figures(
    name: str, scene: Scene, known: Run, settings: Settings
) -> Iterator[Figure]:
    run = _at_all_scans(scene, list(registered.scans(scene, settings)), settings)
    ratio = score(scene, run, _CONVERGED_S).gospa_m / score(scene, known, _CONVERGED_S).gospa_m
    yield at_most(f"{name}, reported poses, registered: GOSPA / known frames", ratio, 1.05)
    lost = ours.run(ours.scans_of(scene, scene.reported), settings)
    worse = score(scene, lost, _CONVERGED_S).gospa_m / score(scene, known, _CONVERGED_S).gospa_m
    yield told(f"{name}, reported poses as they are: GOSPA / known frames", worse)


def _at_all_scans(scene: Scene, scans: Sequence[Scan], settings: Settings) -> Run:
    """A run over some of the scans, what it showed last standing for the others."""
    run = ours.run(scans, settings)
    instants = np.round(scene.t_s * 1e9)
    last = np.searchsorted([scan.t_ns for scan in scans], instants, side="right") - 1
    return run._replace(shown=tuple(run.shown[k] for k in last))


def _fresh_figures(name: str, scenes: Sequence[Scene]) -> Iterator[Figure]:
    for k, scene in enumerate(scenes, 2):
        found = score(scene, ours.run(ours.scans_of(scene, scene.pose), settings_for(scene)))
        limit = _limits(scene).drawn_gospa_m
        yield at_most(f"{name}, draw {k}: GOSPA, known frames", found.gospa_m, limit, "m")


def _parts(name: str, found: Score) -> Iterator[Figure]:
    yield told(f"{name}: rms error of the matched", found.localisation_m, "m")
    yield told(f"{name}: missed", found.missed)
    yield told(f"{name}: false", found.false)


def _scaled(scene: Scene, settings: Settings, features: bool = False) -> tuple[Run, float]:
    """A run, and its time on the machine of the demands by its time here, gauged about it."""
    before = cpu_scale()
    run = ours.run(ours.scans_of(scene, scene.pose, features), settings)
    return run, (before + cpu_scale()) / 2


def _ms(run: Run) -> float:
    return float(run.cpu_s.mean()) * 1e3


def _limits(scene: Scene) -> Limits:
    return _LIMITS[200 if scene.truth.shape[1] <= 200 else 1000]


def _rng(seed: int, targets: int, draw: int) -> np.random.Generator:
    return np.random.default_rng([seed, targets, draw])


if __name__ == "__main__":
    main()
