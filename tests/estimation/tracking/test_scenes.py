"""The scenes of the bench: the convention of the files, and drawn ones like them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bench.tracking import ours
from bench.tracking.scenes import Scene, Size, drawn, evidence, read
from bench.tracking.scoring import score
from estimation.arrays import Array
from estimation.frames import wrap_pi


@pytest.fixture(scope="module")
def scene() -> Scene:
    return drawn(np.random.default_rng(1), Size(100, scans=30))


def counter_clockwise(pose: Array) -> Array:
    return np.column_stack([pose[:, :2], np.pi / 2 - pose[:, 2]])


def written(scene: Scene, path: Path) -> None:
    """As the files have it: angles counter-clockwise from x, bearings from the heading."""
    count = [len(seen.range_m) for seen in scene.seen]
    sensors = scene.sensors
    meta = {
        "pd": sensors.detection,
        "sigma_r": sensors.sigma_range_m,
        "sigma_b": sensors.sigma_bearing_rad,
        "clutter": sensors.clutter,
        "box": sensors.box_m,
    }
    np.savez(
        path,
        scan_t=scene.t_s,
        scan_carrier=scene.carrier,
        pose=counter_clockwise(scene.pose),
        pose_nav=counter_clockwise(scene.reported),
        det_scan=np.repeat(np.arange(len(count)), count),
        det_bearing=-np.concatenate([seen.bearing_rad for seen in scene.seen]),
        det_range=np.concatenate([seen.range_m for seen in scene.seen]),
        det_truth=np.concatenate([seen.truth for seen in scene.seen]),
        det_feat=np.concatenate([seen.feature for seen in scene.seen])[:, None],
        det_cls=np.concatenate([seen.declared for seen in scene.seen]),
        truth=scene.truth,
        alive=scene.alive,
        meta=json.dumps(meta),
    )


def test_a_scene_is_read_as_it_was_written(scene: Scene, tmp_path: Path) -> None:
    written(scene, tmp_path / "scene.npz")
    again = read(tmp_path / "scene.npz")
    assert again.sensors == scene.sensors
    np.testing.assert_allclose(again.pose, scene.pose, atol=1e-9)
    np.testing.assert_allclose(again.reported, scene.reported, atol=1e-9)
    for one, other in zip(again.seen, scene.seen, strict=True):
        for column, given in zip(one, other, strict=True):
            np.testing.assert_allclose(column, given, atol=1e-12)


def test_plots_lie_about_their_targets_as_the_sensors_say(scene: Scene) -> None:
    """Normalised errors of 2000 plots: mean square 1, good to 3 %; three sigmas."""
    errors, hits, chances = [], 0, 0
    for k, seen in enumerate(scene.seen):
        real = np.flatnonzero(seen.truth >= 0)
        away = scene.truth[k, seen.truth[real]] - scene.pose[k, :2]
        turned = wrap_pi(seen.bearing_rad[real] + scene.pose[k, 2] - np.arctan2(*away.T))
        longer = seen.range_m[real] - np.hypot(*away.T)
        errors.append(turned / scene.sensors.sigma_bearing_rad)
        errors.append(longer / scene.sensors.sigma_range_m)
        hits, chances = hits + len(real), chances + int(scene.alive[k].sum())
    assert np.mean(np.concatenate(errors) ** 2) == pytest.approx(1.0, abs=0.07)
    assert hits / chances == pytest.approx(scene.sensors.detection, abs=0.02)


def test_a_tenth_appears_and_a_tenth_vanishes() -> None:
    alive = drawn(np.random.default_rng(2), Size(2000, scans=90)).alive
    assert (~alive[0]).mean() == pytest.approx(0.1, abs=0.02)
    assert (~alive[-1]).mean() == pytest.approx(0.1, abs=0.02)
    assert (np.abs(np.diff(alive.astype(int), axis=0)).sum(axis=0) <= 1).all()


def test_features_speak_for_the_class_of_the_target_and_against_clutter(scene: Scene) -> None:
    seen = scene.seen[0]
    told = evidence(seen)
    best = told.max(axis=0)
    assert np.median(best[seen.truth >= 0]) > 3 * np.median(best[seen.truth < 0])


def test_the_score_of_the_truth_is_nothing_and_of_nothing_all_missed(scene: Scene) -> None:
    perfect = tuple(
        ours.Snapshot(np.flatnonzero(alive), truth[alive], float(alive.sum()))
        for truth, alive in zip(scene.truth, scene.alive, strict=True)
    )
    best = score(scene, ours.Run(perfect, np.zeros(30), None), 0.0)
    assert (best.gospa_m, best.missed, best.identity_changes, best.count_rmse) == (0, 0, 0, 0)
    empty = ours.Snapshot(np.empty(0, dtype=np.intp), np.empty((0, 2)), 0.0)
    worst = score(scene, ours.Run((empty,) * 30, np.zeros(30), None), 0.0)
    number = scene.alive.sum(axis=1)
    assert worst.gospa_m == pytest.approx(np.sqrt(number * 0.5e6).mean())
    assert worst.missed == pytest.approx(number.mean())
