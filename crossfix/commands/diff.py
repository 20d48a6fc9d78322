"""`crossfix diff`: do two recordings say the same, and if not, where and by how much?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from crossfix.commands import Keys

if TYPE_CHECKING:
    from rich.console import RenderableType

    from crossfix.differences import ChannelDiff, Diff, FieldSummary, FirstDifference

SAME, DIFFERENT = 0, 1
RoleName = Literal["input", "truth", "output", "status", "control"]
SHOWN_CHARACTERS = 60


def diff(
    before: Path,
    after: Path,
    /,
    *,
    tolerance: float = 0.0,
    ignore: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    role: Annotated[tuple[RoleName, ...], Parameter(negative="")] = ("input", "truth", "output"),
    keys: Keys = (),
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Compare two recordings message by message, to the last bit.

    How the files are cut into chunks and compressed does not matter, nor what the run is called.
    Names the first message that differs, with the field and both values, and sums up every field
    that differs in numbers. Exit code 0: the same; 1: they differ; 2: one of them cannot be read.

    ```
    crossfix diff recordings/strait.mcap recordings/strait.mcap
    ```

    Args:
        before: a recording.
        after: another.
        tolerance: floats count as equal that differ by no more than this, of the larger one where
            that is above 1; 1e-9 is what recordings of other machines are held to.
        ignore: a field that is not compared, such as `boot` between two runs; may be repeated.
        role: which messages are compared; may be repeated.
        keys: only keys after the run like this, such as `correction/**`; may be repeated.
        as_json: one JSON object instead of tables.
    """
    from crossfix.differences import Rules
    from crossfix.differences import diff as compare
    from crossfix.reading_progress import reading
    from schemas.errors import CrossfixError
    from schemas.keys import Role
    from schemas.recording.reader import open_recording

    if not tolerance >= 0:
        raise CrossfixError("--tolerance", got=tolerance, expected="a number, 0 or above")
    rules = Rules(tolerance, frozenset(ignore))
    roles = [Role(one) for one in role]
    with (
        open_recording(before) as was,
        open_recording(after) as became,
        reading(was, "diff") as show,
    ):
        found = compare(was, became, roles=roles, channels=keys, rules=rules, show=show)
    if as_json:
        print(_json(found))
    else:
        _print(found)
    return SAME if found.is_same else DIFFERENT


def _print(found: Diff) -> None:
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True, markup=False)
    for change in found.settings:
        console.print(f"setting {change.name}: {change.before} -> {change.after}")
    if found.first is None:
        console.print(_sameness(found))
        return
    console.print(_told(found.first))
    same = [channel for channel in found.channels if channel.is_same]
    console.print(f"the same: {sum(c.before for c in same)} messages on {len(same)} channels")
    for channel in found.channels:
        if not channel.is_same:
            console.print(_counts(channel), style="yellow")
            fields = [field for field in found.fields if field.channel == channel.channel]
            if fields:
                console.print(_fields(fields))


def _sameness(found: Diff) -> str:
    messages = sum(channel.before for channel in found.channels)
    close = sum(channel.close for channel in found.channels)
    what = f"the same: {messages} messages on {len(found.channels)} channels"
    return f"{what}, {close} of them within the tolerance" if close else f"{what}, byte for byte"


def _told(first: FirstDifference) -> str:
    from datetime import UTC, datetime

    at = datetime.fromtimestamp(first.t_ns / 1e9, UTC).strftime("%H:%M:%S.%f")[:-3]
    where = f"first difference: {first.channel}, seq {first.sequence}, at {at}"
    if first.only_in:
        side = "first" if first.only_in == "before" else "second"
        return f"{where}: only the {side} recording has this message"
    return f"{where}: {first.field} was {_short(first.before)}, became {_short(first.after)}"


def _counts(channel: ChannelDiff) -> str:
    counts = {
        f"of {channel.before} messages changed": channel.changed,
        "only in the first": channel.only_before,
        "only in the second": channel.only_after,
    }
    told = ", ".join(f"{count} {what}" for what, count in counts.items() if count)
    return f"\n{channel.channel} ({channel.role}): {told}"


def _fields(fields: Sequence[FieldSummary]) -> RenderableType:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("field", no_wrap=True)
    for heading in ("values", "greatest", "mean", "rms"):
        table.add_column(heading, justify="right", no_wrap=True)
    for f in fields:
        numbers = (_number(f.greatest), _number(f.mean), _number(f.rms))
        table.add_row(Text(f.field), str(f.values), *numbers)
    return table


def _json(found: Diff) -> str:
    import msgspec

    facts: dict[str, Any] = {
        "same": found.is_same,
        "first": found.first and found.first._asdict(),
        "channels": [channel._asdict() for channel in found.channels],
        "fields": [field._asdict() for field in found.fields],
        "settings": [change._asdict() for change in found.settings],
    }
    return msgspec.json.encode(facts).decode()


def _number(value: float) -> str:
    return "-" if value != value else f"{value:.3g}"  # noqa: PLR0124 - nan


def _short(value: object) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= SHOWN_CHARACTERS else f"{text[:SHOWN_CHARACTERS]} ..."
