"""Random fleets that nobody has tuned for: what the fusion centre makes of each, by family.

    python -m bench.fleets [--seed N] [--runs N] [--json] [--family NAME ...]

`--runs` counts fleets, the families in turn, all or those that are named. Each is
played in process, with its errors and with none (`known frames`). The second half of a run is
judged. What it cannot but err is `bound`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from bench.figures import Figure, at_least, at_most, between, cpu_scale, options, report, told
from bench.fleets.families import FAMILIES, drawn
from bench.fleets.playing import DIMENSIONS, Pair, both
from crossfix.evaluation.pictures import PLACE_DIMENSIONS
from estimation.consistency import mean_interval

FIVE_SIGMA = 31.8
"""Chi2 of 3 degrees of freedom, as unlikely as five sigmas of one."""
CONFIDENCE = 0.999
TENTHS = (("lowest tenth", 0.1), ("median", 0.5), ("highest tenth", 0.9))


def main() -> None:
    """Play all fleets and print the figures."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--family", action="append", choices=FAMILIES)
    chosen, others = parser.parse_known_args()
    given = options(__doc__ or "", 3 * len(FAMILIES), others)
    report(_figures(given.seed, given.runs, chosen.family or list(FAMILIES)), given)


def _figures(seed: int, runs: int, families: list[str]) -> Iterator[Figure]:
    count = len(families)
    drawings = [(families[n % count], 1000 * seed + n // count) for n in range(runs)]
    fleets = [both(family, drawn(family, number)) for family, number in drawings]
    yield told("fleets", len(fleets))
    yield from _of_frames(fleets)
    yield from _of_pictures(fleets)
    for family in dict.fromkeys(fleet.family for fleet in fleets):
        yield from _of_family(family, [fleet for fleet in fleets if fleet.family == family])


def _of_frames(fleets: list[Pair]) -> Iterator[Figure]:
    wrong = [fleet.erring for fleet in fleets]
    late = [value for outcome in wrong for value in outcome.late()]
    fresh = [value for outcome in wrong for value in outcome.fresh()]
    nees = [e.nees for outcome in wrong for errors in outcome.frames for e in errors]
    yield told("frames of other carriers", sum(outcome.others for outcome in wrong))
    yield at_least("of these applied", len(late), 1)
    if late:
        yield at_most("worst NEES of a frame while applied", max(nees), FIVE_SIGMA)
        interval = mean_interval(DIMENSIONS, len(late), CONFIDENCE)
        yield between("NEES/dim of frames, mean", float(np.mean(late)), *interval)
        yield between("the same, first 30 s applied", float(np.mean(fresh)), *interval)


def _of_pictures(fleets: list[Pair]) -> Iterator[Figure]:
    nees, ratios = _known([f.track_nees for f in fleets]), _known([f.ratio for f in fleets])
    # what frames leave unsure is common to the tracks of a fleet: at worst all are one sample
    interval = mean_interval(PLACE_DIMENSIONS, max(len(nees), 1), CONFIDENCE)
    yield between("NEES/dim of tracks, mean of the fleets", float(np.mean(nees)), *interval)
    yield from _spread("NEES/dim of tracks", nees)
    yield at_most("GOSPA / known frames, median of the fleets", float(np.median(ratios)), 1.05)
    yield from _spread("GOSPA / known frames", ratios)
    allowed = _known([f.allowed for f in fleets])
    yield from _spread("the same as the bound allows", allowed)
    beyond = _known([f.ratio / f.allowed for f in fleets])
    yield at_most("of what the bound allows, median", float(np.median(beyond)), 1.05)
    claimed = _known([f.claimed for f in fleets])
    yield from _spread("claimed sigma of tracks / bound", claimed)
    yield told("share of fleets with GOSPA at most 1.05 times that", float(np.mean(ratios <= 1.05)))
    wrong = [fleet.erring for fleet in fleets]
    false = [outcome.picture.false for outcome in wrong if outcome.picture]
    yield told("false tracks of a fleet", float(np.mean(false)))
    cpu_s = max(outcome.cpu_s for outcome in wrong) * cpu_scale()
    yield at_most("slowest fleet, CPU a step of one second", cpu_s, 0.2, "s, scaled")


def _of_family(family: str, fleets: list[Pair]) -> Iterator[Figure]:
    nees, ratios = _known([f.track_nees for f in fleets]), _known([f.ratio for f in fleets])
    yield told(f"{family}: NEES/dim of tracks, mean", float(np.mean(nees)))
    yield told(f"{family}: GOSPA / known frames, median", float(np.median(ratios)))
    allowed = float(np.median(_known([f.allowed for f in fleets])))
    yield told(f"{family}: as the bound allows, median", allowed)


def _spread(name: str, values: np.ndarray) -> Iterator[Figure]:
    for place, share in TENTHS:
        yield told(f"{name}, {place}", float(np.quantile(values, share)))


def _known(values: list[float]) -> np.ndarray:
    """Those that are numbers."""
    found = np.array(values, dtype=float)
    known: np.ndarray = found[np.isfinite(found)]
    return known


if __name__ == "__main__":
    main()
