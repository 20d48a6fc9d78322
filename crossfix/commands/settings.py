"""`crossfix settings`: everything in the fusion that can be tuned."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from fusion_center.settings import Description


def settings(
    part: str = "",
    /,
    *,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """List what can be tuned in the fusion: name, default, limits, meaning.

    The names serve in `[fusion]` of a scenario and in `crossfix refuse --set`.

    ```
    crossfix settings
    crossfix settings association
    crossfix settings gate --json
    ```

    Args:
        part: only settings whose name has this in it.
        as_json: a JSON list instead of a table.
    """
    from fusion_center.settings import describe
    from schemas.errors import SettingsError

    found = [setting for setting in describe() if part in setting.name]
    if not found:
        raise SettingsError(
            "no such setting", where="settings", got=part, expected="part of a name"
        )
    if as_json:
        import msgspec

        print(msgspec.json.encode([setting._asdict() for setting in found]).decode())
    else:
        _show(found)
    return 0


def _show(found: list[Description]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD)
    for heading in ("setting", "default"):
        table.add_column(heading, no_wrap=True)
    table.add_column("holds")
    table.add_column("is")
    for name, default, limits, doc in found:
        table.add_row(name, str(default), limits, doc)
    Console().print(table)
