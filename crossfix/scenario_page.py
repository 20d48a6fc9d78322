"""Scenario files as a page for people: `docs/scenarios.md`, made of the tables that read them.

`python -m crossfix.scenario_page` writes it; with `--check` it says whether it is current, and
exits with 1 where it is not.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
from msgspec import inspect as types

from fusion_center.settings import describe
from schemas.fields import Message
from schemas.pages import linked, section, table, written_or_checked
from sim_world.scenario.file import ScenarioFile

PAGE = Path(__file__).parents[1] / "docs" / "scenarios.md"
EXAMPLE = """\
name = "two-ships"
title = "Two ships, twelve targets"

[time]
duration_s = 120

[origin]
latitude_deg = 54.3
longitude_deg = 10.2

[fusion]
own = "anna"

[[carriers]]
name = "anna"
motion = { kind = "constant_velocity", east_m = 0, north_m = 0, course_deg = 90, speed_mps = 6 }
sensors = [{ name = "radar", sigma_range_m = 30, sigma_bearing_deg = 0.3, identity_share = 1 }]

[[carriers]]
name = "berta"
motion = { kind = "constant_velocity", east_m = 9_000, north_m = 4_000, course_deg = 270, speed_mps = 5 }
navigation = { sigma_position_m = 500, sigma_north_deg = 1 }
sensors = [{ name = "radar", sigma_range_m = 30, sigma_bearing_deg = 0.3, identity_share = 1 }]

[[target_groups]]
name = "ship"
count = 12
box_m = [-8_000, 16_000, -6_000, 12_000]
speed_mps = [3, 10]
"""  # noqa: E501 - a line of a TOML file
_INTRODUCTION = f"""\
# Scenario files

A scenario says who is there and how they move, what carriers declare of themselves and how they
truly err. It is a TOML file; `crossfix run FILE` runs it. This one is whole:

```toml
{EXAMPLE}```

Saved as `two-ships.toml`, `crossfix run two-ships.toml` shows that `berta`, some 500 m and a degree
in error, is put right to a few metres. The scenarios in [scenarios](../scenarios) show the rest:
recorded ship tracks, passive carriers, beacons and ranges, targets without names.

- Places are metres east and north of the origin; courses and bearings are degrees clockwise from
  north. Degrees are spoken here only: on the wire everything is SI and radians.
- What a carrier *declares* anyone may fetch: name, navigation, sensors, ranging, and of the run
  name, time, origin, beacons and `[fusion]`. The rest is *truth*, which the fusion centre never
  sees: seed, motions, errors, classes, targets.
- Errors that are not given are drawn from the declared sigma by the seed; `[errors] enabled =
  false` makes frames known, with the same noise of the sensors.
- A key that does not exist, or a value outside its limits, is an error that names the key.

`python -m crossfix.scenario_page` makes this page of the tables that read the file.
"""


class Place(NamedTuple):
    """A table of the file: its struct, and where in the file it stands."""

    struct: Message
    where: str


def page() -> str:
    """The whole page."""
    places = list(tables())
    known = {place.struct.__name__ for place in places}
    return "\n".join(
        [
            _INTRODUCTION,
            "## Tables\n",
            *(_in_toml(section(place.struct, known, _after(place))) for place in places),
            "## Settings of the fusion\n",
            _SETTINGS,
            table(("setting", "holds", "default", "is"), _settings()),
        ]
    )


_SETTINGS = """\
In `[fusion]`, as `association.gate = 12` or in a table of its own (`[fusion.association]`). The
same names serve `crossfix refuse --set`, which fuses a recording again with other settings, and
`crossfix tell`. `crossfix settings` prints them.
"""


def tables() -> Iterator[Place]:
    """Every table of a scenario file, the whole file first, each where it stands first."""
    waiting, seen = [Place(ScenarioFile, "")], {ScenarioFile.__name__}
    while waiting:
        place = waiting.pop(0)
        yield place
        for field in msgspec.structs.fields(place.struct):
            for struct, many in _structs(types.type_info(field.type), many=False):
                if struct.__name__ not in seen:
                    seen.add(struct.__name__)
                    name = f"{place.where.strip('[]')}.{field.encode_name}".strip(".")
                    waiting.append(Place(struct, f"[[{name}]]" if many else f"[{name}]"))


def _structs(kind: types.Type, *, many: bool) -> Iterator[tuple[Message, bool]]:
    match kind:
        case types.UnionType(types=members):
            for member in members:
                yield from _structs(member, many=many)
        case types.ListType(item_type=item):
            yield from _structs(item, many=True)
        case types.StructType(cls=cls):
            yield cls, many


def _in_toml(text: str) -> str:
    """TOML has no nil: a key is there or not."""
    return text.replace(" or nil", "").replace("| `null` |", "| absent |")


def _after(place: Place) -> str:
    """Where a table stands, and how it is chosen among others there."""
    config = place.struct.__struct_config__
    chosen = f', `{config.tag_field} = "{config.tag}"`' if config.tag else ""
    return f" `{place.where}`{chosen}." if place.where else ""


def _settings() -> Iterator[tuple[str, str, str, str]]:
    for setting in describe():
        default = msgspec.json.encode(setting.default).decode()
        yield f"`{setting.name}`", linked(setting.limits, set()), f"`{default}`", setting.doc


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page, or check that it is current; the exit code."""
    return written_or_checked(PAGE, page(), "python -m crossfix.scenario_page", arguments)


if __name__ == "__main__":
    sys.exit(main())
