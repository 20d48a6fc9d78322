"""The search in the plane finds what a look at every pair would find."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.tracking import bernoulli, pairing
from estimation.tracking.innovations import Common, foretold, innovations
from estimation.tracking.measurements import polar
from estimation.tracking.pairing import folded, paired
from estimation.tracking.scan import Scan, View
from tests.estimation.tracking.states import KINDS, SITE, plots_of, some_bank, tracks_of

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
    tracks = tracks_of(bank)
    scan = Scan(0, plots, View(SITE), 0.9, 1e-8, common)
    found = bernoulli.gated(tracks, scan, GATE)
    track, plot = (axis.ravel() for axis in np.mgrid[:60, :60])
    each = bank.take(track)
    told = foretold(plots.expected(each.mean, plots.offset_s[plot]), each, common)
    every = innovations(plots.readings(), told, np.arange(len(track)), plot)
    inside = (every.distance_squared() <= GATE).any(axis=0)
    assert inside.sum() >= 40
    got = set(zip(found.track.tolist(), found.plot.tolist(), strict=True))
    want = set(zip(track[inside].tolist(), plot[inside].tolist(), strict=True))
    assert got == want


def test_without_plots_or_tracks_there_are_no_pairs() -> None:
    rng = np.random.default_rng(1)
    for n, m in ((0, 3), (3, 0), (0, 0)):
        tracks = tracks_of(some_bank(rng, n))
        for kind in KINDS:
            scan = Scan(0, plots_of(kind, rng, rng.normal(0, 1e4, (m, 2))), View(SITE), 0.9, 1e-8)
            assert bernoulli.gated(tracks, scan, GATE).track.size == 0


@pytest.mark.parametrize("with_common", [False, True])
def test_plots_with_instants_of_their_own_take_another_path_to_the_same_end(
    with_common: bool,
) -> None:
    """One more plot far off, at another instant: then what is foretold is of pairs, not tracks."""
    rng = np.random.default_rng(4)
    bank = some_bank(rng, 40, 3000.0)
    plots = plots_of("polar", rng, bank.mean[:2, 0].T)
    common = Common(np.diag([50.0, 40.0, 5e-3]) ** 2, SITE) if with_common else None
    ends = []
    for more in (0.0, 0.5):
        late = np.append(np.full(40, 0.3), 0.3 + more)
        columns = [np.append(part, part[0]) for part in plots[1:5]]  # type: ignore[index]
        columns[1][-1] = 1e6
        scan = Scan(0, polar(SITE, *columns, late), View(SITE), 0.9, 1e-8, common)
        found = paired(bank, scan, GATE)
        share = np.broadcast_to(np.sin(found.plot) ** 2 / 10, (2, len(found.track)))
        ends.append((found, folded(bank, found, share)))
    (one, moved), (other, moved_too) = ends
    assert one.owner is None
    assert other.owner is not None
    by_plot = [np.lexsort((each.plot, each.track)) for each in (one, other)]
    np.testing.assert_array_equal(one.track, other.track)
    np.testing.assert_array_equal(one.plot[by_plot[0]], other.plot[by_plot[1]])
    for part, same in zip(moved, moved_too, strict=True):
        np.testing.assert_allclose(part, same, rtol=1e-9, atol=1e-6)


def test_batches_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pairs worked on a few at a time, and all at once: the same moments of every track."""
    rng = np.random.default_rng(5)
    bank = some_bank(rng, 60, 3000.0)
    scan = Scan(0, plots_of("place", rng, bank.mean[:2, 0].T), View(SITE), 0.9, 1e-8)
    every = []
    for batch in (1, 7, 10_000):
        monkeypatch.setattr(pairing, "_BATCH", batch)
        found = paired(bank, scan, GATE)
        share = np.broadcast_to(np.sin(found.plot) ** 2 / 10, (2, len(found.track)))
        every.append((found.track, found.plot, *folded(bank, found, share)))
    assert len(every[0][0]) > 100
    for other in every[1:]:
        for one, same in zip(every[0], other, strict=True):
            np.testing.assert_allclose(one, same, rtol=1e-12)
