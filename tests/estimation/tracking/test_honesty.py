"""Do covariances and probabilities of existence mean what they say?"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.consistency import nees
from estimation.metrics import matched
from estimation.tracking.imm import Motion
from estimation.tracking.tracker import Settings, shown
from tests.estimation.tracking.worlds import (
    SETTINGS,
    scans,
    tracked,
    world,
)


def normalised(seed: int, settings: Settings) -> Array:
    """NEES of the sure tracks of twenty targets, in a world that is as the tracker believes."""
    rng = np.random.default_rng(seed)
    given = world(rng, 90, 20, settings.motion)
    every = []
    for k, picture in enumerate(tracked(scans(rng, given), settings)[15:], 15):
        truth = given.states[k][given.alive[k]]
        found = shown(picture, settings._replace(confirmed=0.9))
        pairs = matched(truth[:, :2], found.mean[:, :2], 400.0)
        error = found.mean[pairs.estimate] - truth[pairs.truth]
        every.append(nees(error, found.covariance[pairs.estimate]))
    return np.concatenate(every)


@pytest.mark.parametrize(("manoeuvring", "tolerance"), [(1.0, 0.1), (100.0, 0.15)])
def test_covariances_are_honest(manoeuvring: float, tolerance: float) -> None:
    """Mean NEES / 4 of 2400 states. Errors last some ten scans, so it is good to 4 %; where targets
    manoeuvre a few surprises make half of the mean, and it is good to 7 %. Two sigmas each.
    """
    settings = SETTINGS._replace(motion=Motion((1.0, manoeuvring)))
    ratios = np.concatenate([normalised(seed, settings) for seed in (4, 5)])
    assert len(ratios) > 2000
    assert abs(ratios.mean() / 4 - 1) < tolerance


class Judged(NamedTuple):
    """Tracks of many pictures against the truth."""

    existence: Array  # of all tracks of some substance
    real: NDArray[np.bool_]


@pytest.fixture(scope="module")
def judged() -> Judged:
    """Of a long run in a world that is as the tracker believes."""
    rng = np.random.default_rng(4)
    given = world(rng, 90, 60)
    pictures = tracked(scans(rng, given))
    existence, real = [], []
    for k in range(15, 90):
        truth = given.states[k][given.alive[k]]
        found = shown(pictures[k], SETTINGS._replace(confirmed=0.02))
        pairs = matched(truth[:, :2], found.mean[:, :2], 400.0)
        existence.append(found.existence)
        real.append(np.isin(np.arange(len(found.mean)), pairs.estimate))
    return Judged(np.concatenate(existence), np.concatenate(real))


@pytest.mark.parametrize(("low", "high"), [(0.02, 0.2), (0.2, 0.8), (0.8, 0.99), (0.99, 1.0)])
def test_existence_is_as_probable_as_it_says(judged: Judged, low: float, high: float) -> None:
    """Share of real tracks against their mean probability, to 0.12 (some hundred in a bin, which
    hang together) and to 0.02 of the sure ones.
    """
    inside = (judged.existence >= low) & (judged.existence < high)
    assert inside.sum() > 50
    apart = abs(judged.real[inside].mean() - judged.existence[inside].mean())
    assert apart < (0.02 if low == 0.99 else 0.12)
