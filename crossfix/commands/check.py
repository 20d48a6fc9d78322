"""`crossfix check`: what is wrong with a publisher, and what its author should do about it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from crossfix.commands import ENDPOINT, Name, Timeout

if TYPE_CHECKING:
    from rich.console import RenderableType

    from schemas.conformance import Conformance, Finding, SigmaCheck
    from schemas.recording.reader import Recording

CLEAN, WRONG, NOTHING_HEARD = 0, 1, 2
HUB_S = 3.0


def check(
    *,
    run: Name | None = None,
    carrier: Name | None = None,
    connect: str = ENDPOINT,
    seconds: Timeout = 20.0,
    recording: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Tell a publisher's author everything that is wrong with it, in one run.

    Listens to a run, holds every message against what docs/publishing.md asks for, asks the
    publishers for what they must answer, and compares claimed sigmas with how the measurements
    scatter. Exit code 0: no errors (there may be warnings); 1: errors; 2: nothing was heard.

    ```
    crossfix check --run strait --carrier visitor
    crossfix check --recording recordings/strait.mcap
    ```

    Args:
        run: name of the run to listen to.
        carrier: only this one, by default all.
        connect: endpoint of the hub.
        seconds: how long to listen; sigmas need some hundred plots of named targets.
        recording: read a recording instead; what only an answer shows is not checked then.
        as_json: one JSON object instead of tables.
    """
    from schemas.errors import CrossfixError

    if recording is not None:
        conformance, found = _read(recording, carrier)
    elif run is not None:
        conformance = _listen(run, carrier, connect, seconds)
        found = conformance.findings()
    else:
        raise CrossfixError("nothing to check", expected="--run NAME or --recording FILE")
    if as_json:
        print(_json(conformance, found))
    else:
        _print(conformance, found)
    if any(finding.severity == "error" for finding in found):
        return WRONG
    return CLEAN if conformance.heard() else NOTHING_HEARD


def _listen(run: str, carrier: str | None, connect: str, seconds: float) -> Conformance:
    from rich.console import Console

    from schemas.bus.zenoh_bus import open_bus
    from schemas.conformance import Listener

    with open_bus(connect, HUB_S) as bus:
        listener = Listener(bus, run, carrier)
        about = carrier or "every carrier"
        Console(stderr=True).print(f"listening to {about} of {run} for {seconds:g} s", style="dim")
        return listener.listen(seconds)


def _read(path: Path, carrier: str | None) -> tuple[Conformance, list[Finding]]:
    """Hold a recording against the rules; its log times are those of the run."""
    from schemas import codec, keys
    from schemas.bus.interface import Sample
    from schemas.conformance import Conformance
    from schemas.recording.reader import open_recording

    with open_recording(path) as opened:
        conformance = Conformance(opened.header.run, carrier)
        scenario = codec.encode(opened.scenario)
        key = keys.SCENARIO.key(opened.header.run)
        conformance.take(Sample(key, scenario, ""), 0.0, fetched=True)
        for message in opened.messages():
            sample = Sample(message.key, message.payload, message.encoding)
            conformance.take(sample, message.log_time_ns * 1e-9)
        _note_refused(conformance, opened, carrier)
    return conformance, conformance.findings()


def _note_refused(conformance: Conformance, recording: Recording, carrier: str | None) -> None:
    """What the recorder refused is not in the recording, but its reasons are."""
    rejections = recording.end.rejections if recording.end else {}
    for name, told in rejections.items():
        who, _, source = name.partition("/")
        if carrier in (None, who):
            conformance.note("refused", who, source, told)


def _print(conformance: Conformance, found: list[Finding]) -> None:
    from rich.console import Console

    console = Console(highlight=False)
    heard = conformance.heard()
    if not heard and not found:
        console.print("nothing was heard: is the run's name right, and does the carrier publish?")
        return
    if found:
        console.print(_findings(found))
    if checks := conformance.sigma_checks():
        console.print(_sigmas(checks))
    errors = sum(finding.severity == "error" for finding in found)
    messages = _many(sum(heard.values()), "message")
    carriers = _many(len({carrier for carrier, _ in heard}), "carrier")
    judged = f"{_many(errors, 'error')}, {_many(len(found) - errors, 'warning')}"
    console.print(f"{messages} of {carriers}: {judged}")


def _many(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _findings(found: list[Finding]) -> RenderableType:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    table = Table("who", "finding", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("first case, and what to do", overflow="fold")
    table.add_column("times", justify="right")
    colours = {"error": "red", "warning": "yellow"}
    for finding in found:
        who = f"{finding.carrier}/{finding.source}".rstrip("/")
        what = Text.assemble(f"{finding.example}\n", (finding.advice, "italic"))
        code = Text(f"{finding.severity}\n{finding.code}", style=colours[finding.severity])
        table.add_row(who, code, what, str(finding.count), end_section=True)
    return table


def _sigmas(checks: dict[tuple[str, str], list[SigmaCheck]]) -> RenderableType:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(
        title="Scatter by claimed sigma (99.99 % interval)", box=SIMPLE_HEAD, pad_edge=False
    )
    for heading in ("source", "of", "scatter/claim", "residuals", "the claim is"):
        table.add_column(heading, no_wrap=True)
    for (carrier, source), columns in checks.items():
        for c in columns:
            scatter = f"{c.ratio:.2f} ({c.low:.2f}-{c.high:.2f})" if c.number else ""
            column = c.column.removeprefix("sigma_")
            table.add_row(f"{carrier}/{source}", column, scatter, str(c.number), c.verdict)
    return table


def _json(conformance: Conformance, found: list[Finding]) -> str:
    import msgspec

    facts = {
        "heard": {f"{who}/{source}": n for (who, source), n in sorted(conformance.heard().items())},
        "findings": found,
        "sigmas": [
            {"carrier": carrier, "source": source, "verdict": check.verdict, **check._asdict()}
            for (carrier, source), checks in conformance.sigma_checks().items()
            for check in checks
        ],
    }
    return msgspec.json.encode(facts).decode()
