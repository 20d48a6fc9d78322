"""What a sensor tells of the features of targets: as its tables declare, and as it truly errs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from estimation.arrays import Array

from .noise import normal
from .scenario.features import FeatureReports, WordReports
from .scenario.file import ClassReports, Sensor
from .scene import Targets

Draws = Mapping[str, Array]
"""Two numbers in (0, 1) for each target, by what they are for."""


def purposes(table: Sensor) -> list[str]:
    """What numbers are drawn for, for each target at each look."""
    values = [
        *(f"feature {f.name}" for f in table.features),
        *(f"word {w.name}" for w in table.words),
    ]
    partly = [f.name for f in table.features if f.share < 1 or f.errors.wrong > 0]
    partly += [w.name for w in table.words if w.share < 1]
    strange = [f"strange {f.name}" for f in table.features if f.errors.wrong > 0]
    return [*values, *(f"fate {name}" for name in partly), *strange]


def numbers(table: Sensor, targets: Targets, draws: Draws) -> dict[str, Array]:
    """Values (N,) by name; NaN where a log brings none."""
    return {f.name: _values(f, targets.features[f.name], draws) for f in table.features}


def _values(feature: FeatureReports, true: Array, draws: Draws) -> Array:
    sigma = feature.errors.sigma or feature.sigma
    value: Array = true + sigma * normal(draws[f"feature {feature.name}"])[:, 0]
    fate = draws.get(f"fate {feature.name}")
    if fate is None:
        return value
    if feature.errors.wrong > 0 and feature.population:
        least, greatest = feature.population
        anything = least + (greatest - least) * draws[f"strange {feature.name}"][:, 0]
        value = np.where(fate[:, 1] < feature.errors.wrong, anything, value)
    return np.where(fate[:, 0] < feature.share, value, np.nan)


def words(table: Sensor, targets: Targets, draws: Draws) -> dict[str, np.ndarray]:
    """Words (N,) by name; None where a log brings none, or the target has none."""
    blank = np.full(len(targets.number), "", dtype=object)
    return {w.name: _told(w, targets.words.get(w.name, blank), draws) for w in table.words}


def _told(word: WordReports, true: np.ndarray, draws: Draws) -> np.ndarray:
    """The true word with the sensor's accuracy, else another."""
    names, has = word.categories, true != ""
    index = np.array([names.index(name) if name else 0 for name in true], dtype=int)
    u, v = draws[f"word {word.name}"].T
    other = (index + 1 + np.floor(v * (len(names) - 1)).astype(int)) % len(names)
    told = np.array(names, dtype=object)[np.where(u < actual_accuracy(word), index, other)]
    fate = draws.get(f"fate {word.name}")
    told[~has if fate is None else ~has | (fate[:, 0] >= word.share)] = None
    return told


def actual_accuracy(word: WordReports | ClassReports) -> float:
    """Share of the words that are right, whatever is declared."""
    return word.accuracy if word.errors.accuracy is None else word.errors.accuracy


def of_nobody(feature: FeatureReports, rng: np.random.Generator, count: int) -> Array:
    """What false alarms show of a number; nothing where its population is not declared."""
    return rng.uniform(*feature.population, count) if feature.population else np.full(count, np.nan)


def any_word(word: WordReports, rng: np.random.Generator, count: int) -> np.ndarray:
    """What false alarms show of a word."""
    return np.array(word.categories, dtype=object)[rng.integers(len(word.categories), size=count)]
