"""Settings of the fusion centre changed by name, and two sets of them held against each other."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import msgspec
from msgspec.structs import replace

from fusion_center.settings import settings_from
from schemas.errors import SettingsError
from schemas.messages import DeclaredScenario

TABLE = "fusion."
"""How a scenario file calls what is a setting of its own here."""


class SettingChange(NamedTuple):
    """One setting of two recordings, by its dotted name."""

    name: str
    before: Any
    after: Any


def with_changes(scenario: DeclaredScenario, overrides: Mapping[str, Any]) -> DeclaredScenario:
    """The scenario with other settings, by dotted names such as `association.gate`.

    Raises:
        SettingsError: no such setting, or a value outside its limits.
    """
    table = copy.deepcopy(scenario.fusion)
    for name, value in overrides.items():
        *groups, leaf = name.removeprefix(TABLE).split(".")
        inner = table
        for group in groups:
            inner = inner.setdefault(group, {})
            if not isinstance(inner, dict):
                raise SettingsError("no such setting", where=name, got=value)
        inner[leaf] = value
    settings_from(table)
    return replace(scenario, fusion=table)


def changes_between(before: DeclaredScenario, after: DeclaredScenario) -> list[SettingChange]:
    """Every setting in which two scenarios differ, defaults included.

    Raises:
        SettingsError: one of them has a setting that this version does not know.
    """
    was, became = (dict(_leaves(settings_from(s.fusion))) for s in (before, after))
    return [SettingChange(n, was[n], became[n]) for n in was if was[n] != became[n]]


def _leaves(settings: object) -> Iterator[tuple[str, Any]]:
    yield from _flat(msgspec.to_builtins(settings), "")


def _flat(table: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value
