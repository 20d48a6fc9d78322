"""The search in the plane finds what a look at every pair would find."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.tracking import bernoulli
from estimation.tracking.bernoulli import Tracks
from estimation.tracking.features import Layout, unknown
from estimation.tracking.innovations import Common, innovations
from estimation.tracking.scan import Scan, View
from tests.estimation.tracking.states import KINDS, SITE, plots_of, some_bank

GATE = 16.0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("with_common", [False, True])
@pytest.mark.parametrize("half_m", [3000.0, 12_000.0, 60_000.0])
def test_no_pair_within_the_gate_is_missed(kind: str, with_common: bool, half_m: float) -> None:
    """Sensor in the middle: plots on both sides of the seam of bearings, and close by."""
    rng = np.random.default_rng(int(half_m))
    bank = some_bank(rng, 60, half_m)
    bank = bank._replace(mean=bank.mean + np.pad(SITE, (0, 2))[:, None, None])
    plots = plots_of(kind, rng, bank.mean[:2, 0].T)
    common = Common(np.diag([50.0, 40.0, 5e-3]) ** 2, SITE) if with_common else None
    tracks = Tracks(np.arange(60), np.ones(60), bank, np.ones((1, 60)), unknown(Layout(), 60))
    scan = Scan(0, plots, View(SITE), 0.9, 1e-8, common)
    found = bernoulli.gated(tracks, scan, GATE)
    track, plot = (axis.ravel() for axis in np.mgrid[:60, :60])
    mean, covariance, _ = bank.take(track)
    every = innovations(plots.rows(mean, plot), mean, covariance, common)
    inside = (every.distance_squared() <= GATE).any(axis=0)
    assert inside.sum() >= 40
    got = set(zip(found.track.tolist(), found.plot.tolist(), strict=True))
    want = set(zip(track[inside].tolist(), plot[inside].tolist(), strict=True))
    assert got <= want
    assert len(got) >= 0.995 * len(want)  # the plane is flat, the noise of a bearing bends


def test_without_plots_or_tracks_there_are_no_pairs() -> None:
    rng = np.random.default_rng(1)
    for n, m in ((0, 3), (3, 0), (0, 0)):
        tracks = Tracks(
            np.arange(n), np.ones(n), some_bank(rng, n), np.ones((1, n)), unknown(Layout(), n)
        )
        for kind in KINDS:
            scan = Scan(0, plots_of(kind, rng, rng.normal(0, 1e4, (m, 2))), View(SITE), 0.9, 1e-8)
            assert bernoulli.gated(tracks, scan, GATE).track.size == 0
