"""Colours of carriers: told apart by everybody, on white and on a dark page."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from crossfix.report.style import CARRIERS, DARK, mixed, pale

SIGHTS = {
    "usual": np.eye(3),
    "protanopia": np.array([
        [0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ]),
    "deuteranopia": np.array([
        [0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ]),
    "tritanopia": np.array([
        [1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ]),
}  # fmt: skip
"""Linear RGB as it is seen: Machado, Oliveira & Fernandes, IEEE Trans. VCG 15(6), 2009."""
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
WHITE = np.array([0.9505, 1.0, 1.089])


@pytest.mark.parametrize("sight", SIGHTS)
def test_colours_of_carriers_are_told_apart(sight: str) -> None:
    """Distances in CIELAB; 2.3 is just seen, and thin lines want several times that."""
    assert nearest(CARRIERS[:3], sight) > 25
    assert nearest(CARRIERS, sight) > 14
    assert nearest([DARK[colour] for colour in CARRIERS[:3]], sight) > 20


@pytest.mark.parametrize("colour", CARRIERS)
def test_what_is_to_be_corrected_is_paler_on_every_ground(colour: str) -> None:
    assert lightness(pale(colour)) > lightness(colour) + 15
    assert lightness(DARK[pale(colour)]) < lightness(DARK[colour])


def test_a_mixture_begins_and_ends_with_its_parts() -> None:
    assert mixed("#123456", "#ffffff", 1.0) == "#123456"
    assert mixed("#123456", "#ffffff", 0.0) == "#ffffff"
    assert mixed("#000000", "#ffffff", 0.5) == "#808080"


def nearest(colours: list[str] | tuple[str, ...], sight: str) -> float:
    seen = [lab(colour, SIGHTS[sight]) for colour in colours]
    return min(float(np.linalg.norm(a - b)) for a, b in combinations(seen, 2))


def lightness(colour: str) -> float:
    return float(lab(colour, SIGHTS["usual"])[0])


def lab(colour: str, seen: np.ndarray) -> np.ndarray:
    """CIELAB (3,) of `#rrggbb` as somebody sees it."""
    rgb = np.array([int(colour[n : n + 2], 16) for n in (1, 3, 5)]) / 255
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    x, y, z = np.cbrt(XYZ @ np.clip(seen @ linear, 0, 1) / WHITE)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])
