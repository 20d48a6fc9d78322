"""`crossfix doctor`: is everything here that a run needs, and what to do where it is not?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from crossfix.doctor import Finding

BAD = 1
COLOURS = {"ok": "green", "warn": "yellow", "bad": "bold red"}


def doctor(
    *,
    connect: str | None = None,
    recordings: Path = Path("recordings"),
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Examine this machine: versions, ports, a hub's round trip, disk, clocks, and a tiny run.

    One line a check, ok, warn or bad, with what to do below it. The tiny run starts real
    processes, corrects a carrier's frame, and fuses its recording again; it leaves nothing behind.
    Exit code 0: runs will work; 1: something is bad.

    ```
    crossfix doctor
    crossfix doctor --connect tcp/192.0.2.7:7447 --json
    ```

    Args:
        connect: hub to examine, and to run the tiny run on; by default one is started here.
        recordings: folder that recordings go to.
        as_json: one JSON object instead of lines.
    """
    from crossfix.doctor import examine, worst

    findings = []
    for finding in examine(connect, recordings):
        findings.append(finding)
        if not as_json:
            _show(finding)
    if as_json:
        _show_json(findings)
    else:
        _show_table(findings)
    return BAD if worst(findings) == "bad" else 0


def _show(finding: Finding) -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    verdict = (f"{finding.verdict:5}", COLOURS[finding.verdict])
    console.print(Text.assemble(verdict, f"{finding.what:15} {finding.found}"))
    if finding.advice:
        console.print(Text(f"{'':20} do: {finding.advice}", style=COLOURS[finding.verdict]))


def _show_table(findings: list[Finding]) -> None:
    from crossfix.table import print_frames

    for finding in findings:
        if finding.frames:
            print_frames(list(finding.frames))


def _show_json(findings: list[Finding]) -> None:
    import msgspec

    from crossfix.doctor import worst

    lines = [
        finding._asdict() | {"frames": [frame._asdict() for frame in finding.frames]}
        for finding in findings
    ]
    print(msgspec.json.encode({"verdict": worst(findings), "findings": lines}).decode())
