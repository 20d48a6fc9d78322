"""The plots of the pages: well-formed, and every point where its axes say."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from bench import svg


def circles(path: Path) -> list[tuple[float, float]]:
    found = [e for e in ElementTree.parse(path).iter() if e.tag.endswith("circle")]
    return [(float(e.attrib["cx"]), float(e.attrib["cy"])) for e in found]


def test_points_lie_where_the_axes_say(tmp_path: Path) -> None:
    axes = svg.logarithmic("x", [1.0, 100.0]), svg.linear("y", 0.0, 2.0, 0.5)
    curves = [
        svg.Curve("measured", [1.0, 10.0, 100.0], [0.0, 1.0, 2.0], "#c44"),
        svg.Curve("bound", [1.0, 100.0], [0.0, 2.0], "#888", dashed=True),
    ]
    svg.plot(tmp_path / "plot.svg", "title", axes, curves, (svg.LEFT, svg.TOP))
    low, high = svg.MARGIN, svg.WIDTH - svg.MARGIN
    foot, head = svg.HEIGHT - svg.MARGIN, svg.MARGIN
    middle = ((low + high) / 2, (foot + head) / 2)
    assert circles(tmp_path / "plot.svg") == [(low, foot), middle, (high, head)]
    text = (tmp_path / "plot.svg").read_text()
    assert all(name in text for name in ("title", "measured", "bound", "stroke-dasharray"))


def test_ticks_stay_within() -> None:
    assert svg.linear("y", 0.0, 1.0, 0.25).ticks == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert svg.logarithmic("x", [2.0, 30.0]).ticks == [2.0, 5.0, 10.0, 20.0]
    padded = svg.logarithmic("x", [2.0, 30.0], padded=True)
    assert (padded.low, padded.high) == (0.0, 1.5)


@pytest.mark.parametrize("name", ["000-ratio", "000-heading", "000-time", "002-pairs", "002-rule"])
def test_the_pages_show_plots_of_this_kind(name: str) -> None:
    path = Path(__file__).parents[2] / "docs" / "papers" / "figures" / f"{name}.svg"
    inside = [0 <= x <= svg.WIDTH and 0 <= y <= svg.HEIGHT for x, y in circles(path)]
    assert len(inside) > 5
    assert all(inside)
    assert re.search(rf"\({re.escape(f'figures/{name}.svg')}\)", _page(name))


def _page(name: str) -> str:
    return (Path(__file__).parents[2] / "docs" / "papers" / f"{name[:3]}.md").read_text()
