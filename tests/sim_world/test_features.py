"""Laws of features: as wrong as the truth says, whatever is declared, and nobody else's noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from carriers.carrier import Carrier, Stamp
from schemas.errors import ScenarioError
from schemas.messages import SourceReport
from sim_world.scenario import parse_scenario
from sim_world.scenario.toml_text import toml_text
from sim_world.world import World
from tests.sim_world.scenes import Tree, carrier, radar, target, tree
from tests.sim_world.test_sensors import Scene, scene

LENGTH: Tree = {"name": "length_m", "unit": "m", "sigma": 4.0, "population": [5.0, 400.0]}
EMITTER: Tree = {"name": "emitter", "categories": ["s", "x", "off"], "accuracy": 0.9}
CLASSES: list[Tree] = [
    {
        "name": "cargo",
        "features": {"length_m": [150.0, 20.0]},
        "words": {"emitter": {"s": 3.0, "x": 1.0}},
    }
]
GROUP: Tree = {
    "name": "many", "count": 4000, "box_m": [-2e4, 2e4, -2e4, 2e4], "classes": {"cargo": 1.0},
}  # fmt: skip


FEW = 300
"""Targets of a law that holds for each of them; the group's number is for statistics."""


def seen(
    features: list[Tree] | None = None,
    words: list[Tree] | None = None,
    count: int = GROUP["count"],
    **more: Any,
) -> Scene:
    keys = {"features": features or [], "words": words or [], **more}
    return scene(radar=keys, classes=CLASSES, targets=[], target_groups=[GROUP | {"count": count}])


def lengths(made: Scene) -> tuple[np.ndarray, np.ndarray]:
    """What is measured, and the truth of it, by identity."""
    logs, truth = made.observe(), made.truth[0]
    by_name = dict(zip(truth.identity, truth.features["length_m"], strict=True))
    assert logs.identity is not None
    return logs.features["length_m"], np.array([by_name[name] for name in logs.identity])


def emitters(made: Scene) -> tuple[np.ndarray, np.ndarray]:
    logs, truth = made.observe(), made.truth[0]
    by_name = dict(zip(truth.identity, truth.words["emitter"], strict=True))
    assert logs.identity is not None
    return logs.words["emitter"], np.array([by_name[name] for name in logs.identity])


def test_the_actual_sigma_may_differ_from_the_declared_one() -> None:
    made = seen([LENGTH | {"errors": {"sigma": 12.0}}])
    measured, true = lengths(made)
    assert np.std(measured - true) == pytest.approx(12.0, rel=0.05)
    assert made.sensor.declared.features["length_m"].sigma == 4.0
    assert "12" not in str(made.scenario.declared.carriers)


def test_the_noise_is_the_same_but_for_its_size() -> None:
    one, true = lengths(seen([LENGTH], count=FEW))
    other, _ = lengths(seen([LENGTH | {"errors": {"sigma": 12.0}}], count=FEW))
    np.testing.assert_allclose(other - true, 3.0 * (one - true), atol=1e-9)


def test_a_share_of_the_logs_brings_it() -> None:
    measured, _ = lengths(seen([LENGTH | {"share": 0.7}]))
    assert np.isfinite(measured).mean() == pytest.approx(0.7, abs=0.03)
    told, _ = emitters(seen(words=[EMITTER | {"share": 0.7}]))
    assert np.mean([word is not None for word in told]) == pytest.approx(0.7, abs=0.03)


def test_a_share_of_the_values_is_plain_wrong() -> None:
    measured, true = lengths(seen([LENGTH | {"errors": {"wrong": 0.2}}]))
    strange = np.abs(measured - true) > 20.0
    expected = 0.2 * (1 - 40 / 395)
    assert strange.mean() == pytest.approx(expected, abs=0.02)
    assert measured[strange].std() == pytest.approx(395 / np.sqrt(12), rel=0.1)


@pytest.mark.parametrize(("actual", "right"), [({}, 0.9), ({"accuracy": 0.5}, 0.5)])
def test_words_are_right_as_often_as_the_truth_says(actual: Tree, right: float) -> None:
    made = seen(words=[EMITTER | {"errors": actual}])
    told, true = emitters(made)
    assert np.mean(told == true) == pytest.approx(right, abs=0.03)
    wrong = told[(told != true) & (true == "s")]
    assert np.mean(wrong == "x") == pytest.approx(0.5, abs=0.1)
    assert np.mean(true == "s") == pytest.approx(0.75, abs=0.03)
    info = made.sensor.declared.features["emitter"]
    assert info.categories == EMITTER["categories"]
    assert info.confusion[1] == pytest.approx([0.05, 0.9, 0.05])


def test_a_target_without_a_word_is_not_told() -> None:
    targets = [target("ada", words={"emitter": "x"}), target("bob", east_m=-5e3)]
    made = scene(radar={"words": [EMITTER | {"accuracy": 1.0}]}, targets=targets)
    logs = made.observe()
    assert logs.identity is not None
    assert dict(zip(logs.identity, logs.words["emitter"], strict=True)) == {"ada": "x", "bob": None}


def test_classes_are_right_as_often_as_the_truth_says() -> None:
    classes = [CLASSES[0], {"name": "yacht", "features": {"length_m": [15.0, 2.0]}}]
    made = scene(
        radar={"classes": {"accuracy": 0.9, "errors": {"accuracy": 0.6}}},
        classes=classes,
        targets=[],
        target_groups=[GROUP],
    )
    told = made.observe().classes
    assert told is not None
    assert np.mean(told == "cargo") == pytest.approx(0.6, abs=0.03)
    assert made.sensor.declared.features["class"].confusion[0] == pytest.approx([0.9, 0.1])


def test_features_move_no_other_noise() -> None:
    plain = seen(count=FEW).observe()
    rich = seen([LENGTH | {"share": 0.5}], [EMITTER], FEW).observe()
    np.testing.assert_array_equal(plain.bearing_rad, rich.bearing_rad)
    alone, _ = lengths(seen([LENGTH], count=FEW))
    beside, _ = lengths(seen([LENGTH | {"share": 0.5}], [EMITTER], FEW))
    kept = np.isfinite(beside)
    np.testing.assert_array_equal(alone[kept], beside[kept])


def test_false_alarms_show_any_word() -> None:
    made = scene(
        radar={"words": [EMITTER], "clutter_per_scan": 600.0},
        targets=[target("ada", words={"emitter": "x"})],
    )
    words = made.observe().words["emitter"]
    assert all(0.25 < np.mean(words == name) < 0.42 for name in EMITTER["categories"])


def test_reports_carry_words_and_numbers_that_are_missing() -> None:
    made = tree(
        [carrier("own", radar(features=[LENGTH | {"share": 0.5}], words=[EMITTER]))],
        classes=CLASSES,
        targets=[],
        target_groups=[GROUP | {"count": 50}],
    )
    made_scenario = parse_scenario(toml_text(made))
    said = Carrier(made_scenario, "own").step(*World(made_scenario).step(3), Stamp("b"))
    report = next(out.message for out in said if isinstance(out.message, SourceReport))
    assert set(report.features["emitter"].values) <= {"s", "x", "off"}
    assert 5 < report.features["length_m"].values.count(None) < 45
    assert report.features["emitter"].sigmas is None


@pytest.mark.parametrize(
    ("word", "where"),
    [
        (EMITTER | {"name": "emiter"}, "emiter"),
        (EMITTER | {"name": "class"}, "class"),
        (EMITTER | {"categories": ["s", "off"]}, "categories"),
        (EMITTER | {"categories": ["s"]}, "categories"),
    ],
)
def test_words_that_cannot_be_are_refused(word: Tree, where: str) -> None:
    with pytest.raises(ScenarioError, match=where):
        seen(words=[word])


def test_a_word_and_a_number_cannot_share_a_name() -> None:
    classes = [CLASSES[0] | {"words": {"length_m": {"s": 1.0}}}]
    with pytest.raises(ScenarioError, match="given twice"):
        scene(
            radar={"features": [LENGTH], "words": [EMITTER | {"name": "length_m"}]},
            classes=classes,
            targets=[],
            target_groups=[GROUP],
        )
