"""The page of scenario files: current, whole, and its example is a scenario that comes right."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bench.in_process import played
from crossfix import scenario_page
from crossfix.evaluation import frame_errors
from fusion_center.settings import describe
from schemas.fields import fields_of
from sim_world.scenario import parse_scenario
from sim_world.scenario.file import ScenarioFile


def test_it_is_current() -> None:
    assert scenario_page.main(["--check"]) == 0


def test_a_stale_page_is_told_and_mended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(scenario_page, "PAGE", tmp_path / "scenarios.md")
    assert scenario_page.main(["--check"]) == 1
    assert "python -m crossfix.scenario_page" in capsys.readouterr().err
    assert scenario_page.main([]) == 0
    assert scenario_page.main(["--check"]) == 0


def test_every_key_and_every_setting_is_on_it() -> None:
    page = scenario_page.page()
    places = list(scenario_page.tables())
    assert len(places) > 20
    assert places[0] == (ScenarioFile, "")
    for place in places:
        section = page.split(f"\n### {place.struct.__name__}\n")[1].split("\n### ")[0]
        named = re.findall(r"^\| `(\w+)` ", section.split("\n## ")[0], re.MULTILINE)
        assert named == [field.name for field in fields_of(place.struct)]
        assert not place.where or f"`{place.where}`" in section
    assert all(f"| `{setting.name}` |" in page for setting in describe())


def test_a_table_is_named_by_where_it_stands() -> None:
    where = {place.struct.__name__: place.where for place in scenario_page.tables()}
    assert where["Time"] == "[time]"
    assert where["Sensor"] == "[[carriers.sensors]]"
    assert where["SensorErrors"] == "[carriers.sensors.errors]"
    assert '`kind = "waypoints"`' in scenario_page.page()


def test_its_example_is_put_right_as_it_says() -> None:
    toml = re.findall(r"```toml\n(.*?)```", scenario_page.page(), re.DOTALL)
    scenario = parse_scenario(toml[0], "two-ships.toml")
    said = []
    for step in played(scenario, steps=40):
        said += [step.carriers, *step.corrections.values()]
    last = frame_errors(scenario.declared, "anna", said)["berta"][-1]
    before, after = ((x**2 + y**2) ** 0.5 for x, y in (last.before_m, last.after_m))
    assert last.state == "applied"
    assert before > 100
    assert after < 20
