"""Measure how good and how honest tracks are by kind of motion, print it.

Run `python -m bench.motions [--seed N] [--runs N] [--json]`. Motions are drawn; recorded ones are
cut from the files in the folder that `CROSSFIX_DATA` names, if they are there. `--runs` is the
number of targets of each kind in a world, for each of three sets of radars.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bench.figures import Figure, Options, at_most, between, options, report, told
from bench.motions.recorded import SOURCES, harbour, recorded
from bench.motions.scoring import Errors, errors
from bench.motions.sights import EVERY, Radars, sights
from bench.motions.told import SINGLE, filtered
from bench.motions.tracked import lost, settings_for, tracked
from bench.motions.worlds import AIRCRAFT, SHIPS, World, drawn, in_pairs

_SECONDS = 400.0
_SHIPS_M, _AIRCRAFT_M = 15e3, 30e3  # half of the square of their middles
_HONEST = (0.85, 1.15)
_APART_M, _COMPANY_MPS = (5.0, 10.0, 20.0, 40.0, 70.0, 100.0), 5.0


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print."""
    given = options("Tracks by kind of motion; --runs: targets of each kind.", 24, arguments)
    report(list(figures(given)), given)


def figures(given: Options) -> Iterator[Figure]:
    """Every world under every set of radars."""
    for number, world in enumerate(worlds(given)):
        for radars in EVERY:
            rng = np.random.default_rng([given.seed, 5, number])
            yield from _world_figures(rng, world, radars)
    yield from side_by_side(given)


def side_by_side(given: Options) -> Iterator[Figure]:
    """Pairs near each other, with lengths that differ and without; and a harbour."""
    each = max(given.runs // 3, 1)
    for speed, what in ((0.0, "at rest"), (_COMPANY_MPS, "in company")):
        rng = np.random.default_rng([given.seed, 2])
        world = in_pairs(rng, _APART_M, each, speed, _SECONDS, _SHIPS_M)
        for radars in (EVERY[0], EVERY[2]):
            yield from _beside(f"pairs {what}, {radars.name}", world, radars, given)
            named = f"pairs {what}, with lengths, {radars.name}"
            yield from _beside(named, world, radars._replace(lengths=True), given)
    folder = Path(os.environ.get("CROSSFIX_DATA", ""))
    if (folder / SOURCES[0].files[0]).is_file():
        yield from _beside(f"Solent, {EVERY[0].name}", harbour(folder, _SECONDS), EVERY[0], given)


def _beside(name: str, world: World, radars: Radars, given: Options) -> Iterator[Figure]:
    """Error and honesty by distance."""
    every = sights(np.random.default_rng([given.seed, 6]), world, radars)
    run = tracked(world, every, settings_for(world, lengths=radars.lengths))
    for kind, apart in enumerate(world.kinds):
        of = world.kind == kind
        found = run.errors.only(of[run.errors.target])
        yield told(f"{name}, {apart}: error", found.rms_m(), "m")
        yield at_most(f"{name}, {apart}: NEES/2", found.mean(found.place)[0], _HONEST[1])
        yield told(f"{name}, {apart}: identity changes", run.changes[of].sum())
    yield told(f"{name}: GOSPA", run.gospa_m, "m")


def worlds(given: Options) -> Iterator[World]:
    """Drawn motions, and the recorded ones that are there."""
    rng, each = np.random.default_rng([given.seed, 1]), given.runs
    yield drawn(rng, SHIPS, each, _SECONDS, _SHIPS_M)
    yield drawn(rng, AIRCRAFT, each, _SECONDS, _AIRCRAFT_M)
    folder = Path(os.environ.get("CROSSFIX_DATA", ""))
    for source in SOURCES:
        half_m = _SHIPS_M if source.kind.startswith("ships") else _AIRCRAFT_M
        if all((folder / name).is_file() for name in source.files):
            yield recorded(rng, source, folder, 2 * each, _SECONDS, half_m)


def _world_figures(rng: np.random.Generator, world: World, radars: Radars) -> Iterator[Figure]:
    """The tracker by kind, beside the best filter of one model that is told whose each plot is."""
    every = sights(rng, world, radars)
    run = tracked(world, every, settings_for(world))
    single = [errors(world, filtered(every, world.kind.size, motion)) for motion in SINGLE]
    for kind, name in enumerate(world.kinds):
        mine, of = f"{name}, {radars.name}", world.kind == kind
        found = run.errors.only(of[run.errors.target])
        yield told(f"{mine}: error", found.rms_m(), "m")
        best = min(each.only(of[each.target]).rms_m() for each in single)
        yield told(f"{mine}: / best filter of one model, told whose", found.rms_m() / best)
        yield from _honesty(mine, world, found)
        yield at_most(f"{mine}: lost", lost(run, of), 0.0)
        yield told(f"{mine}: identity changes", run.changes[of].sum())
    name = f"{world.kinds[0]}{' to ' + world.kinds[-1] if len(world.kinds) > 1 else ''}"
    yield told(f"{name}, {radars.name}: GOSPA", run.gospa_m, "m")
    yield told(f"{name}, {radars.name}: false tracks", run.false)


def _honesty(mine: str, world: World, found: Errors) -> Iterator[Figure]:
    """NEES of places by two, as a whole and by what targets do just then; of states by four."""
    mean, sigma = found.mean(found.place)
    yield between(f"{mine}: NEES/2 of the place", mean, *_HONEST)
    yield told(f"{mine}: its sigma, by targets", sigma)
    yield told(f"{mine}: NEES/4 of the state", found.mean(found.state)[0])
    turning, hastening = (
        each[found.row, found.target] for each in (world.turning, world.hastening)
    )
    doing = {
        "straight": ~turning & ~hastening,
        "turning": turning,
        "changing speed": hastening & ~turning,
    }
    for what, which in doing.items():
        if 0 < which.sum() < len(which):
            some = found.only(which)
            yield told(f"{mine}, {what}: error", some.rms_m(), "m")
            yield told(f"{mine}, {what}: NEES/2", some.mean(some.place)[0])


if __name__ == "__main__":
    main()
