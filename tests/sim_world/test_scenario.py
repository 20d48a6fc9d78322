"""Scenario files: what is wrong is refused by name, what is right survives every way of writing."""

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas import codec
from schemas.errors import ScenarioError
from schemas.messages import DeclaredScenario, TruthScenario
from sim_world.scenario import load_scenario, parse_override, parse_scenario, with_overrides
from sim_world.scenario.toml_text import toml_text
from tests.sim_world.scenes import Tree, carrier, radar, scenario, target, tree

SCENARIOS = Path(__file__).parents[2] / "scenarios"


def full() -> Tree:
    """A file with every kind of table in it."""
    waypoints = {
        "kind": "waypoints",
        "points_m": [[0.0, 0.0], [5e3, 0.0], [0.0, 5e3]],
        "speed_mps": 9.0,
    }
    turn = {"kind": "coordinated_turn", "turn_rate_deg_s": 1.0, "speed_mps": 5.0}
    sensor = radar(
        sector_deg=[10.0, 350.0],
        classes={"accuracy": 0.8},
        features=[{"name": "length_m", "sigma": 5.0, "population": [5.0, 400.0]}],
        errors={"range_bias_m": 12.0},
    )
    fix = {"sigma_position_m": 5.0, "fix": {"period_s": 10.0, "sigma_m": 5.0}}
    return tree(
        [
            carrier("own", sensor, errors={"north_deg": 0.5}),
            carrier("other", motion=waypoints, navigation=fix),
        ],
        classes=[{"name": "cargo", "features": {"length_m": [150.0, 30.0]}}],
        errors={"enabled": True},
        fusion={"own": "other", "association": {"gate": 12.0}},
        targets=[
            {**target("ada", **turn), "class": "cargo"},
            {**target("bob", features={"length_m": 12.0}), "start_s": 5.0, "end_s": 50.0},
        ],
        target_groups=[
            {
                "name": "many",
                "count": 3,
                "box_m": [-1e4, 1e4, -1e4, 1e4],
                "classes": {"cargo": 1.0},
                "motions": {"coordinated_turn": 0.5, "constant_velocity": 0.5},
            }
        ],
    )


def places(value: Any, *path: str | int) -> Iterator[tuple[str | int, ...]]:
    """The path of every key in a file, tables of the fusion centre left out."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in items:
        if path[:1] != ("fusion",) and key != "fusion":
            if isinstance(value, dict):
                yield (*path, key)
            if isinstance(inner, dict | list):
                yield from places(inner, *path, key)


def parent(file: Tree, path: tuple[str | int, ...]) -> Any:
    for step in path[:-1]:
        file = file[step]  # type: ignore[index]
    return file


def refused(file: Tree) -> ScenarioError:
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(toml_text(file), "test.toml")
    assert caught.value.where.startswith("test.toml: "), caught.value
    return caught.value


PLACES = list(places(full()))
FREE = ("features", "classes", "motions")
"""Tables whose keys are the user's own names."""


def test_the_full_file_is_valid() -> None:
    declared = parse_scenario(toml_text(full())).declared
    assert [c.name for c in declared.carriers] == ["own", "other"]
    assert declared.fusion == {"own": "other", "association": {"gate": 12.0}}


@given(st.sampled_from(PLACES), st.data())
def test_a_misspelt_key_is_named_with_what_it_was_meant_to_be(
    path: tuple[str | int, ...], data: st.DataObject
) -> None:
    file = full()
    table, key = parent(file, path), str(path[-1])
    cut = data.draw(st.integers(0, len(key) - 1))
    wrong = key[:cut] + "zq" + key[cut:]
    table[wrong] = table.pop(key)
    error = refused(file)
    free = len(path) > 1 and path[-2] in FREE
    assert wrong in str(error) or key in str(error)
    if not free:
        missing = error.what == "missing key" and error.where.endswith(key)
        assert missing or error.where.endswith(wrong)
        assert missing or len(key) < 5 or f"{key} (the nearest known)" in error.expected


@given(st.sampled_from(PLACES), st.sampled_from([True, "zq zq", -1e20, [[]], {"zq": 1}]))
def test_a_value_of_the_wrong_kind_is_named_with_its_key(
    path: tuple[str | int, ...], wrong: object
) -> None:
    file = full()
    table, key = parent(file, path), str(path[-1])
    if isinstance(wrong, str) and isinstance(table[key], str) and key not in ("name", "kind"):
        wrong = -1e20
    if isinstance(wrong, bool) and isinstance(table[key], bool):
        wrong = 3
    table[key] = wrong
    assert key in refused(file).where.split(": ")[1].replace("[", ".").split(".")


def complaint(file: Tree) -> str:
    """What is said against a file; nothing if it is valid."""
    try:
        parse_scenario(toml_text(file), "test.toml")
    except ScenarioError as error:
        return str(error)
    return ""


NEEDED = {"name", "kind", "origin", "time", "carriers", "motion", "duration_s", "sigma_bearing_deg"}


@pytest.mark.parametrize("path", PLACES, ids=lambda path: ".".join(map(str, path)))
def test_a_key_that_is_needed_is_named_when_it_is_missing(path: tuple[str | int, ...]) -> None:
    file, key = full(), str(path[-1])
    del parent(file, path)[key]
    said = complaint(file)
    named = key in said or (path[-2:-1] and path[-2] in FREE and path[-2] in said)
    assert named if said else key not in NEEDED


CONTRADICTIONS: dict[str, tuple[dict[str, Any], str]] = {
    # dotted keys to set in the full file -> the key that must be named
    "two carriers of one name": ({"carriers.1.name": "own"}, "carriers.own.name"),
    "a reserved carrier": (
        {"carriers.1.name": "fusion", "fusion.own": "own"},
        "carriers.fusion.name",
    ),
    "a reserved sensor": (
        {"carriers.own.sensors.0.name": "navigation"},
        "carriers.own.sensors.navigation.name",
    ),
    "two targets of one name": ({"targets.1.name": "ada"}, "targets.ada.name"),
    "two targets of one identity": ({"targets.1.identity": "ada"}, "targets.bob.identity"),
    "no such own carrier": ({"fusion.own": "owm"}, "fusion.own"),
    "ranges without sigma": (
        {"carriers.other.sensors": [{"name": "r", "sigma_bearing_deg": 1}]},
        "carriers.other.sensors.r.sigma_range_m",
    ),
    "bearings with a range sigma": (
        {"carriers.own.sensors.radar.coordinates": "bearing"},
        "carriers.own.sensors.radar.sigma_range_m",
    ),
    "an empty annulus": (
        {"carriers.own.sensors.radar.range_min_m": 1e6},
        "carriers.own.sensors.radar.range_max_m",
    ),
    "clutter without limit": (
        {"carriers.own.sensors.radar.range_max_m": 1e9,
         "carriers.own.sensors.radar.clutter_per_scan": 1},
        "carriers.own.sensors.radar.range_max_m",
    ),
    "a feature nobody has": (
        {"carriers.own.sensors.radar.features.length_m.name": "lenght_m"},
        "carriers.own.sensors.radar.features.lenght_m.name",
    ),
    "a population upside down": (
        {"carriers.own.sensors.radar.features.length_m.population": [9, 1]},
        "carriers.own.sensors.radar.features.length_m.population",
    ),
    "a clock past all bounds": (
        {"carriers.own.navigation.sigma_clock_s": 0.5},
        "carriers.own.navigation.sigma_clock_s",
    ),
    "a clock that drifts past all bounds": (
        {"carriers.own.navigation.sigma_clock_drift_ppm": 1e5},
        "carriers.own.navigation.sigma_clock_drift_ppm",
    ),
    "corrections to itself": (
        {"carriers.other.use_corrections": True},
        "carriers.other.use_corrections",
    ),
    "corrections to itself, by another gauge": (
        {"carriers.own.use_corrections": True, "fusion.own": "own"},
        "carriers.own.use_corrections",
    ),
    "no such class": ({"targets.ada.class": "crago"}, "targets.ada.class"),
    "a target without a feature": ({"targets.bob.features": {}}, "targets.bob.class"),
    "a target that is never there": ({"targets.bob.end_s": 4}, "targets.bob.end_s"),
    "a turn that never is": (
        {"targets.ada.motion.from_s": 9, "targets.ada.motion.until_s": 8},
        "targets.ada.motion.until_s",
    ),
    "a limit never reached": (
        {"targets.ada.motion": {"kind": "constant_acceleration", "east_m": 0, "north_m": 0,
                                "course_deg": 0, "speed_mps": 5, "acceleration_mps2": 1,
                                "speed_limit_mps": 4}},
        "targets.ada.motion.speed_limit_mps",
    ),
    "a line back on itself": (
        {"carriers.other.motion.points_m": [[0, 0], [1, 1], [0, 0]],
         "carriers.other.motion.closed": False},
        "carriers.other.motion.points_m",
    ),
    "a loop of two points": (
        {"carriers.other.motion.points_m": [[0, 0], [1, 1]], "carriers.other.motion.closed": True},
        "carriers.other.motion.points_m",
    ),
    "a leg of no length": (
        {"carriers.other.motion.points_m": [[0, 0], [0, 0]]},
        "carriers.other.motion.points_m",
    ),
    "a motion groups do not have": (
        {"target_groups.many.motions": {"waypoints": 1}},
        "target_groups.many.motions",
    ),
    "weights of nothing": (
        {"target_groups.many.classes": {"cargo": 0}},
        "target_groups.many.classes",
    ),
    "a box upside down": ({"target_groups.many.box_m": [1, 0, 0, 1]}, "target_groups.many.box_m"),
    "a run shorter than a step": ({"time.step_s": 100}, "time.duration_s"),
    "a time before Unix": ({"time.epoch": "1969-01-01T00:00:00Z"}, "time.epoch"),
    "a time of no zone": ({"time.epoch": "2026-01-01T00:00:00"}, "time.epoch"),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "key"), CONTRADICTIONS.values(), ids=CONTRADICTIONS)
def test_contradictions_are_refused_by_name(changes: dict[str, Any], key: str) -> None:
    whole = parse_scenario(toml_text(full()), "test.toml")
    with pytest.raises(ScenarioError) as caught:
        with_overrides(whole, changes)
    assert caught.value.where == f"test.toml: {key}"


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("targets.ada.motion.kind", "coordinate_turn", "coordinated_turn (the nearest known)"),
        ("carriers.own.motion.kind", "track", "one of constant_acceleration, constant_velocity"),
        ("carriers.own.sensors.radar.coordinates", "polar", "one of bearing, bearing_range"),
        ("time.epoch", "tomorrow", "a time such as 2026-01-01T00:00:00Z"),
        ("carriers.own.name", "Own", "[a-z0-9_-], 1 to 32"),
        ("time.duration_s", -1, "float > 0"),
    ],
)
def test_what_is_expected_is_said_in_the_words_of_the_file(
    key: str, value: object, expected: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        with_overrides(parse_scenario(toml_text(full())), {key: value})
    assert caught.value.got == value
    assert expected in caught.value.expected


def test_text_that_is_no_toml_is_refused_with_its_line() -> None:
    with pytest.raises(ScenarioError, match=r"test\.toml.*line 2"):
        parse_scenario('name = "a"\nseed = = 1', "test.toml")


@given(st.integers(0, 2**63 - 1), st.booleans(), st.floats(0, 90))
def test_overridden_text_says_what_the_overridden_scenario_is(
    seed: int, enabled: bool, sigma: float
) -> None:
    overrides = {
        "seed": seed,
        "errors.enabled": enabled,
        "carriers.own.navigation.sigma_north_deg": sigma,
        "fusion.association.gate": 7.0,
        "fusion.new.setting": "x",
    }
    changed = with_overrides(parse_scenario(toml_text(full())), overrides)
    assert changed.file.seed == changed.truth.seed == seed
    assert changed.file.errors.enabled == enabled
    assert changed.file.carriers[0].navigation.sigma_north_deg == sigma
    assert changed.declared.fusion["association"] == {"gate": 7.0}
    assert changed.declared.fusion["new"] == {"setting": "x"}
    again = parse_scenario(changed.truth.text)
    assert (again.file, again.declared, again.truth) == changed[4:]


@pytest.mark.parametrize(
    ("key", "got", "expected"),
    [
        ("carriers.onw.use_corrections", "onw", "own (the nearest known)"),
        ("time.duration_s.value", "duration_s", "a table"),
    ],
)
def test_an_override_of_what_is_not_there_says_what_is(key: str, got: str, expected: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        with_overrides(parse_scenario(toml_text(full())), {key: 1})
    assert (caught.value.got, caught.value.expected) == (got, expected)


def test_overrides_leave_the_original_alone() -> None:
    before = scenario()
    with_overrides(before, {"seed": 99})
    assert before.tree["seed"] == before.file.seed == 7


@pytest.mark.parametrize("key", ["carriers.nobody.name", "targets.0", "seed.x", "targets.ada.zq"])
def test_an_override_of_what_is_not_there_is_refused(key: str) -> None:
    with pytest.raises(ScenarioError, match=key.rsplit(".", maxsplit=1)[-1]):
        with_overrides(scenario(), {key: 1})


def test_overrides_of_a_command_line() -> None:
    assert parse_override("seed=5") == ("seed", 5)
    assert parse_override("errors.enabled=false") == ("errors.enabled", False)
    assert parse_override("fusion.own = levante") == ("fusion.own", "levante")
    assert parse_override('title="a = b"') == ("title", "a = b")
    assert parse_override("box=[1, 2]") == ("box", [1, 2])
    with pytest.raises(ScenarioError, match="key=value"):
        parse_override("seed")


VALUES = st.recursive(
    st.one_of(
        st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False), st.text(),
        st.datetimes(), st.dates(),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=12,
)  # fmt: skip


@given(st.dictionaries(st.text(max_size=5), VALUES, max_size=4))
def test_toml_text_parses_to_its_tree(any_tree: Tree) -> None:
    assert tomllib.loads(toml_text(any_tree)) == any_tree


def test_the_declared_part_says_nothing_of_the_truth() -> None:
    one = scenario()
    other = with_overrides(
        one,
        {
            "seed": 8,
            "errors.enabled": False,
            "carriers.own.errors.north_deg": 3.0,
            "carriers.own.motion.speed_mps": 1.0,
            "carriers.own.sensors.radar.errors.range_bias_m": 9.0,
            "targets.ada.motion.east_m": 7.0,
        },
    )
    assert codec.encode(one.declared) == codec.encode(other.declared)


def test_declared_and_truth_travel() -> None:
    whole = parse_scenario(toml_text(full()))
    declared = codec.decode(DeclaredScenario, codec.encode(whole.declared))
    assert declared == whole.declared
    truth = codec.decode(TruthScenario, codec.encode(whole.truth))
    assert parse_scenario(truth.text).file == whole.file


def test_steps_count_whole_steps_of_the_duration() -> None:
    for step_s, duration_s, steps in ((1, 60, 60), (0.1, 3, 30), (0.25, 1.1, 4), (7, 60, 8)):
        changed = scenario(time={"step_s": step_s, "duration_s": duration_s})
        assert changed.declared.steps == steps


def test_every_shipped_scenario_is_valid(tmp_path: Path) -> None:
    (tmp_path / "solent_ais_20160112.csv.gz").touch()
    names = {load_scenario(path, data=tmp_path).declared.name for path in SCENARIOS.glob("*.toml")}
    assert names >= {"strait", "paper000", "solent"}


def test_a_missing_file_of_tracks_says_what_to_set(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CROSSFIX_DATA", raising=False)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(SCENARIOS / "solent.toml")
    assert caught.value.where.endswith("solent.toml: tracks.ais.file")
    assert "--data" in str(caught.value)
    assert "CROSSFIX_DATA" in str(caught.value)


def test_files_are_sought_by_the_environment_too(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "solent_ais_20160112.csv.gz").touch()
    monkeypatch.setenv("CROSSFIX_DATA", str(tmp_path))
    assert load_scenario(SCENARIOS / "solent.toml").declared.name == "solent"


@pytest.mark.parametrize("name", ["absent.toml", "binary.toml"])
def test_a_file_that_cannot_be_read_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match=name):
        load_scenario(tmp_path / name)
