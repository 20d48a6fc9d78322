"""`crossfix info`: what a recording holds, from its index alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from rich.console import RenderableType

    from schemas.recording.reader import Summary


def info(
    recording: Path,
    /,
    *,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> None:
    """Show what a recording holds: run, times, channels, how it ended and what was lost.

    Messages are not read, so a large recording takes no longer than a small one; `crossfix verify`
    reads them. Of a recording whose recorder was killed, everything that can be read is shown.

    ```
    crossfix info recordings/strait.mcap
    ```

    Args:
        recording: the MCAP file.
        as_json: one JSON object instead of tables.
    """
    from rich.console import Console

    from schemas.recording.reader import summary

    found = summary(recording)
    if as_json:
        print(_json(found))
        return
    console = Console()
    console.print(_facts(found))
    console.print(_channels(found))


def duration_s(summary: Summary) -> float:
    """From the first message to the last, in scenario time [s]."""
    return (summary.end_ns - summary.start_ns) * 1e-9


def ending(summary: Summary) -> str:
    """How the recording ended, in words."""
    if summary.end is None:
        return summary.condition or "unknown: the recorder left no word"
    return "; ".join(filter(None, (summary.end.reason, summary.condition)))


def losses(summary: Summary) -> str:
    """What was lost on the way to the file, in words."""
    if summary.end is None:
        return "unknown"
    end = summary.end
    if end.dropped == end.gaps == 0:
        return "none"
    return f"{end.dropped} dropped by the recorder, {end.gaps} never arrived"


def part(summary: Summary) -> str:
    """Which part of a recording in several files it is, in words."""
    return f", part {summary.header.part}" if summary.header.part else ""


def lost_by_key(summary: Summary) -> dict[str, str]:
    """What never came into the file of each key, in words; of whole keys nothing."""
    found = {}
    for row in summary.statistics.keys if summary.statistics else ():
        counts = {
            "dropped": row.dropped,
            "never arrived": row.gaps,
            "refused": row.rejected,
            "passed over": row.passed_over if row.recorded else 0,
        }
        if words := [f"{count} {what}" for what, count in counts.items() if count]:
            found[row.key] = ", ".join(words)
    return found


def refusals(summary: Summary) -> str:
    """Whose messages were refused for what they held, and why, in words."""
    if summary.end is None:
        return "unknown"
    lines = [f"{source}: {told}" for source, told in summary.end.rejections.items()]
    return "\n".join([str(summary.end.rejected), *lines]) if summary.end.rejected else "none"


def _json(summary: Summary) -> str:
    import msgspec

    facts = summary._asdict() | {
        "duration_s": duration_s(summary),
        "channels": [channel._asdict() for channel in summary.channels],
    }
    return msgspec.json.encode(facts).decode()


def _times(summary: Summary) -> str:
    if not summary.messages:
        return "none: no message can be read"
    return f"{_instant(summary.start_ns)} for {duration_s(summary):.1f} s"


def _facts(summary: Summary) -> RenderableType:
    from rich.table import Table

    header = summary.header
    facts = {
        "recording": f"{summary.path}, {_bytes(summary.bytes)}, {summary.messages} messages",
        "run": f"{header.run}{part(summary)}, scenario {header.scenario or 'unknown'}",
        "scenario time": _times(summary),
        "recorded": f"{_instant(header.created_ns)} by crossfix {_version(summary)}",
        "ending": ending(summary),
        "losses": losses(summary),
        "refused": refusals(summary),
        "attached": ", ".join(summary.attachments),
    }
    table = Table.grid(padding=(0, 2))
    for name, fact in facts.items():
        table.add_row(name, fact)
    return table


def _channels(summary: Summary) -> RenderableType:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table("channel", "role", "message", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("messages", justify="right")
    table.add_column("Hz", justify="right")
    lost = lost_by_key(summary)
    if lost:
        table.add_column("not recorded")
    span_s = duration_s(summary)
    for channel in summary.channels:
        table.add_row(
            _within_run(channel.key),
            channel.role,
            channel.message.removeprefix("crossfix."),
            str(channel.messages),
            f"{channel.messages / span_s:.2f}" if span_s > 0 else "",
            *([lost.get(channel.key, "")] if lost else []),
        )
    return table


def _within_run(key: str) -> str:
    """A key without version and run, which all of them share."""
    from schemas.keys import PREFIX

    return key.split("/", 3)[3] if key.startswith(f"{PREFIX}/") else key


def _bytes(count: int) -> str:
    from rich.filesize import decimal

    return decimal(count)


def _instant(t_ns: int) -> str:
    from datetime import UTC, datetime

    return datetime.fromtimestamp(t_ns // 10**9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def _version(summary: Summary) -> str:
    return summary.header.versions.get("crossfix", "from its source tree")
