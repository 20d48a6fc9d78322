"""Scenario files: TOML with a declared and a truth part, validated before anything starts."""

from .loading import (
    DATA_VARIABLE,
    Scenario,
    load_scenario,
    parse_override,
    parse_scenario,
    with_overrides,
)

__all__ = [
    "DATA_VARIABLE",
    "Scenario",
    "load_scenario",
    "parse_override",
    "parse_scenario",
    "with_overrides",
]
