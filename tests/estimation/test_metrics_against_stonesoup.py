"""GOSPA and OSPA against an implementation that is not ours."""

from __future__ import annotations

from datetime import datetime

import numpy as np
import pytest

from estimation.metrics import gospa, ospa

ospametric = pytest.importorskip(
    "stonesoup.metricgenerator.ospametric", reason="the extra `bench` is not installed"
)
state = pytest.importorskip("stonesoup.types.state")

pytestmark = pytest.mark.filterwarnings("ignore")


def states(places):
    now = datetime(2026, 1, 1)
    return [state.State(place[:, None], timestamp=now) for place in places]


def pictures(c: float, p: int):
    rng = np.random.default_rng([int(10 * c), p])
    for _ in range(10):
        yield [rng.uniform(0, 6, (rng.integers(1, 25), 2)) for _ in range(2)]


@pytest.mark.parametrize("p", [1, 2])
@pytest.mark.parametrize("c", [0.7, 3.0])
def test_gospa_and_its_parts_agree(c: float, p: int) -> None:
    theirs = ospametric.GOSPAMetric(c=c, p=p)
    for truth, found in pictures(c, p):
        ours = gospa(truth, found, c, p)
        metric, _ = theirs.compute_gospa_metric(states(found), states(truth))
        assert ours.distance == pytest.approx(metric.value["distance"])
        assert ours.missed**p == pytest.approx(metric.value["missed"])
        assert ours.false**p == pytest.approx(metric.value["false"])


@pytest.mark.parametrize("p", [1, 2])
@pytest.mark.parametrize("c", [0.7, 3.0])
def test_ospa_agrees_or_is_the_better_assignment(c: float, p: int) -> None:
    """Theirs assigns by distance and not by its power, which is the least for p = 1 only."""
    theirs = ospametric.OSPAMetric(c=c, p=p)
    for truth, found in pictures(c, p):
        whole = theirs.compute_OSPA_distance(states(found), states(truth)).value
        ours = ospa(truth, found, c, p).distance
        assert ours <= whole + 1e-9
        assert ours == pytest.approx(whole, rel=1e-9 if p == 1 else 0.05)
