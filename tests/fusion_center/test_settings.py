"""The settings tree: every default is within its limits, and errors name what was meant."""

from __future__ import annotations

import msgspec
import pytest

from fusion_center.settings import Settings, describe, settings_from, with_setting
from schemas.errors import SettingsError


def test_every_setting_has_a_doc_and_a_default_within_its_limits() -> None:
    rows = describe()
    assert len({row.name for row in rows}) == len(rows) > 10
    for row in rows:
        assert row.doc
        assert row.limits
        assert with_setting(Settings(), row.name, row.default) == Settings()


def test_a_table_sets_what_it_names_and_leaves_the_rest() -> None:
    settings = settings_from({"own": "b", "association": {"gate": 12}, "monitor": {}})
    assert settings.own == "b"
    assert settings.association.gate == 12.0
    assert settings.monitor == Settings().monitor
    assert settings_from({}) == Settings()


def test_one_setting_is_changed_by_its_dotted_name() -> None:
    changed = with_setting(Settings(), "association.gate", 12.0)
    assert changed.association.gate == 12.0
    assert changed.logs == Settings().logs
    assert Settings().association.gate != 12.0


@pytest.mark.parametrize(
    ("table", "where", "meant"),
    [
        ({"asociation": {"gate": 9.0}}, "asociation.gate", "association.gate"),
        ({"association": {"gat": 9.0}}, "association.gat", "association.gate"),
        ({"ownn": "a"}, "ownn", "own"),
        ({"logs": 3}, "logs", "logs."),
    ],
)
def test_an_unknown_name_is_refused_with_the_nearest_known(
    table: dict[str, object], where: str, meant: str
) -> None:
    with pytest.raises(SettingsError) as error:
        settings_from(table)
    assert error.value.where == where
    assert meant in error.value.expected


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("association.gate", "wide"),
        ("association.gate", 0.0),
        ("association.gate", float("nan")),
        ("association.gate", float("inf")),
        ("association.gate", True),
        ("monitor.apply_after", 2.5),
        ("monitor.apply_after", 0),
        ("monitor.chi2_false_alarm", 1.0),
        ("own", "No Such Id"),
        ("own", None),
    ],
)
def test_a_value_outside_its_limits_is_refused_with_them(name: str, value: object) -> None:
    with pytest.raises(SettingsError) as error:
        with_setting(Settings(), name, value)
    limits = {row.name: row.limits for row in describe()}
    assert error.value.where == name
    assert error.value.got is value
    assert error.value.expected == limits[name]


def test_settings_survive_being_packed() -> None:
    settings = with_setting(Settings(), "logs.max_age_s", 7.5)
    packed = msgspec.msgpack.encode(settings)
    assert msgspec.msgpack.decode(packed, type=Settings) == settings
