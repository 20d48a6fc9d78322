"""The demands on the tracker, on scenes small enough for every run of the tests."""

from __future__ import annotations

import numpy as np
import pytest

from bench.tracking import arrival, ours, registered
from bench.tracking.scenes import Scene, Size, drawn
from bench.tracking.scoring import score
from estimation.tracking.marginals import by_assignment


@pytest.fixture(scope="module")
def scene() -> Scene:
    return drawn(np.random.default_rng(5), Size(100, 70e3, 60))


def test_gospa_of_a_drawn_scene(scene: Scene) -> None:
    """A hundred targets at the density of the demands' 200: 900 m / sqrt 2, plus a tenth."""
    settings = ours.settings_for(scene)
    found = score(scene, ours.run(ours.scans_of(scene, scene.pose), settings))
    assert found.gospa_m < 700
    assert found.identity_changes <= 3
    assert found.count_rmse < 0.03
    simple = settings._replace(associate=by_assignment)
    assert score(scene, ours.run(ours.scans_of(scene, scene.pose), simple)).gospa_m < 800


def test_features_help_where_targets_are_close() -> None:
    scene = drawn(np.random.default_rng(6), Size(400, 15e3, 40))
    settings = ours.settings_for(scene)
    without = score(scene, ours.run(ours.scans_of(scene, scene.pose), settings))
    told = settings._replace(classes=(0.25,) * 4)
    found = score(scene, ours.run(ours.scans_of(scene, scene.pose, features=True), told))
    assert found.gospa_m < 0.95 * without.gospa_m
    assert found.identity_changes < without.identity_changes


def test_registered_poses_are_nearly_as_good_as_known_ones(scene: Scene) -> None:
    settings = ours.settings_for(scene)
    known = ours.run(ours.scans_of(scene, scene.pose), settings)
    given = list(registered.scans(scene, settings))
    assert len(given) > 50
    run = ours.run(given, settings)
    last = [
        np.searchsorted([s.t_ns for s in given], round(t * 1e9), "right") - 1 for t in scene.t_s
    ]
    every = run._replace(shown=tuple(run.shown[k] for k in last))
    assert score(scene, every, 30.0).gospa_m < 1.05 * score(scene, known, 30.0).gospa_m


def test_late_scans_give_the_same_bits(scene: Scene) -> None:
    settings = ours.settings_for(scene)
    cost = arrival.cost(ours.scans_of(scene, scene.pose), settings, 1, repeats=1)
    assert cost.identical
    assert cost.steps < 1.4
