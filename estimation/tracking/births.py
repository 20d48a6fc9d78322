"""What a plot is if it is of no track: clutter, or a target not detected before."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.tracking import aside, bernoulli, features, imm, undetected
from estimation.tracking.bernoulli import Tracks
from estimation.tracking.coverage import share_in_view
from estimation.tracking.features import Features, Layout
from estimation.tracking.imm import Motion
from estimation.tracking.innovations import corrected, foretold, innovations
from estimation.tracking.measurements import Found
from estimation.tracking.scan import Scan
from estimation.tracking.undetected import Look, Undetected


class Alone(NamedTuple):
    """The m plots of a scan, each as if it were of no track.

    Attributes:
        density: (m,) of such plots in measurement space: clutter and new targets.
        tracks: one a plot, with the probability that it is a target; none if the plots fix no
            place. Identities are rows, until someone gives them better ones.
        undetected: what the scan leaves undetected.
    """

    density: Array
    tracks: Tracks
    undetected: Undetected


def alone(
    expected: Undetected, scan: Scan, motion: Motion, classes: Array, layout: Layout
) -> Alone:
    """Every plot as clutter or a new target.

    Args:
        expected: undetected targets just before the scan.
        scan: one report.
        motion: of targets.
        classes: (classes,) prior probabilities.
        layout: of the features.
    """
    found = scan.plots.found()
    if found is None:
        clutter = np.full(scan.plots.size, scan.clutter)
        nobody = bernoulli.none(len(classes), layout, motion.models)
        return Alone(clutter, nobody, expected)
    visible = share_in_view(scan.view, expected.region)
    look = Look(visible, scan.detection, found.place_m, scan.clutter)
    expected = undetected.first_looked(expected, look)
    fresh, fitness = _fresh(found, scan, motion, classes, layout)
    density = undetected.density_at(expected, found.place_m) * scan.detection * fitness
    both = (scan.clutter + density) * found.area
    share = density / np.maximum(scan.clutter + density, 1e-300)
    return Alone(both, fresh._replace(existence=share), undetected.thinned(expected, look))


def _fresh(
    found: Found, scan: Scan, motion: Motion, classes: Array, layout: Layout
) -> tuple[Tracks, Array]:
    """A track from each plot, and how well new targets explain what it says beside its place."""
    bank = imm.born(found.place_m, found.covariance_m2, scan.plots.offset_s, motion)
    fitness = np.ones(scan.plots.size)
    every = np.arange(scan.plots.size)
    readings = scan.plots.readings().beside()
    if len(readings.value):
        expected = scan.plots.expected(bank.mean, scan.plots.offset_s).beside()
        expects = foretold(expected, bank)
        extra = innovations(readings, expects, every, every)
        fitness = (bank.model * np.exp(extra.log_density)).sum(axis=0)
        bank = corrected(bank, expects, extra)
    prior = np.repeat(classes[:, None], scan.plots.size, axis=-1)
    posterior, told = bernoulli.judged(prior, scan.evidence, every)
    known, said = _known(scan, layout), aside.unheard(len(every))
    return Tracks(every, fitness, bank, posterior, known, said), fitness * told


def _known(scan: Scan, layout: Layout) -> Features:
    """What each plot by itself tells of features."""
    nothing = features.unknown(layout, scan.plots.size)
    if scan.features is None:
        return nothing
    every = np.arange(scan.plots.size)
    return features.after(nothing, scan.features, every, every)
