"""Scenario files read, overridden and resolved to what the processes of a run need."""

from __future__ import annotations

import copy
import os
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from schemas.errors import ScenarioError
from schemas.messages import DeclaredScenario, TruthScenario

from .checks import check
from .declared import declare
from .file import ScenarioFile
from .motions import TrackFile
from .toml_text import toml_text
from .validation import key_of, nearest, step_to, validated

DATA_VARIABLE = "CROSSFIX_DATA"
"""Environment variable that names the folder of recorded tracks."""


class Scenario(NamedTuple):
    """A valid scenario.

    Attributes:
        where: the file, as errors name it.
        folders: where files that it names are sought, in this order.
        text: the whole file, overrides included.
        tree: the same, parsed.
        file: the same, typed: degrees and seconds, both parts.
        declared: the declared part, as anyone may fetch it.
        truth: the truth part, as simulated carriers and the recorder get it.
    """

    where: str
    folders: tuple[Path, ...]
    text: str
    tree: Mapping[str, Any]
    file: ScenarioFile
    declared: DeclaredScenario
    truth: TruthScenario

    def data_file(self, name: str, *path: str | int) -> Path:
        """The file that the scenario calls `name`, at `path` in its tree.

        Raises:
            ScenarioError: it is nowhere; says where it was sought and what to set.
        """
        candidates = [folder / name for folder in self.folders]
        found = next((c for c in candidates if c.is_file()), None)
        if found is None:
            raise ScenarioError(
                "no such file",
                where=f"{self.where}: {key_of(dict(self.tree), *path)}",
                got=name,
                expected="it in one of "
                + ", ".join(str(folder) for folder in self.folders)
                + f"; name its folder by --data DIR or {DATA_VARIABLE}",
            )
        return found


def load_scenario(
    path: str | Path,
    overrides: Mapping[str, Any] | None = None,
    data: str | Path | None = None,
) -> Scenario:
    """Read, override and check a scenario file.

    Args:
        overrides: dotted key -> value, see `with_overrides`.
        data: folder of recorded tracks; default: that of `DATA_VARIABLE`.

    Raises:
        ScenarioError: what is wrong in it and where.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "not a text file"
        raise ScenarioError(
            "cannot be read", where=str(path), got=why, expected="a scenario file"
        ) from None
    extra = data or os.environ.get(DATA_VARIABLE)
    folders = (path.parent, Path(extra)) if extra else (path.parent,)
    scenario = parse_scenario(text, str(path), folders)
    scenario = with_overrides(scenario, overrides) if overrides else scenario
    for name, *key in _track_files(scenario.file):
        scenario.data_file(name, *key)
    return scenario


def parse_scenario(text: str, where: str = "scenario", folders: tuple[Path, ...] = ()) -> Scenario:
    """A scenario from its text, such as `TruthScenario.text`; files it names are not sought.

    Raises:
        ScenarioError: what is wrong in it and where.
    """
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError("not TOML", where=where, got=str(error)) from None
    return _scenario(where, folders, text, tree)


def with_overrides(scenario: Scenario, overrides: Mapping[str, Any]) -> Scenario:
    """The same scenario with other values.

    Args:
        overrides: dotted key -> value; items of lists by their name or number, such as
            `{"seed": 5, "carriers.levante.navigation.sigma_north_deg": 2}`.

    Raises:
        ScenarioError: no such key, or a value that does not fit it.
    """
    tree = copy.deepcopy(dict(scenario.tree))
    for key, value in overrides.items():
        _override(tree, key, value, scenario.where)
    return _scenario(scenario.where, scenario.folders, toml_text(tree), tree)


def parse_override(text: str) -> tuple[str, Any]:
    """`key=value` of a command line; the value as TOML has it, or else a string.

    Raises:
        ScenarioError: no `=` in it.
    """
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise ScenarioError("not an override", where="--set", got=text, expected="key=value")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()


def _scenario(where: str, folders: tuple[Path, ...], text: str, tree: dict[str, Any]) -> Scenario:
    file = validated(tree, where)
    check(file, tree, where)
    truth = TruthScenario(name=file.name, seed=file.seed, text=text)
    return Scenario(where, folders, text, tree, file, declare(file), truth)


def _track_files(file: ScenarioFile) -> Iterator[tuple[str, *tuple[str | int, ...]]]:
    """Every file of tracks that a scenario names, each followed by its key."""
    for n, target in enumerate(file.targets):
        if isinstance(target.motion, TrackFile):
            yield target.motion.file, "targets", n, "motion", "file"
    for n, tracks in enumerate(file.tracks):
        yield tracks.file, "tracks", n, "file"


def _override(tree: dict[str, Any], dotted: str, value: Any, where: str) -> None:
    """Put a value into the tree; tables on the way are made, items of lists must exist."""
    *path, last = dotted.split(".")
    table: Any = tree
    for step in path:
        above = table
        table = above.setdefault(step, {}) if isinstance(above, dict) else _item(above, step)
        if not isinstance(table, dict | list):
            known = nearest(step, _names(above)) if isinstance(above, list) else "a table"
            at = f"{where}: {dotted}"
            raise ScenarioError("no such table", where=at, got=step, expected=known)
    if isinstance(table, list):
        expected = "a key of an item, such as " + ", ".join(_names(table)[:3])
        raise ScenarioError("not a key", where=f"{where}: {dotted}", got=last, expected=expected)
    table[last] = value


def _item(items: list[Any], step: str) -> Any:
    """The item of a list by its name or its number, None where there is none."""
    numbered = {str(n): item for n, item in enumerate(items)}
    named = dict(zip(_names(items), items, strict=True))
    return named.get(step, numbered.get(step))


def _names(items: list[Any]) -> list[str]:
    return [step_to(n, item) for n, item in enumerate(items)]
