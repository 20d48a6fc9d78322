"""`crossfix refuse`: the inputs of a recording fused again, with other settings if wanted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from crossfix.refusing import Refused


def refuse(
    recording: Path,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o")],
    overrides: Annotated[tuple[str, ...], Parameter(name="--set", negative="")] = (),
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> None:
    """Fuse the inputs of a recording again, as fast as it goes, into a new recording.

    Everything but the outputs is passed on byte for byte; the settings it was fused with stand in
    the new recording, which therefore repeats itself under `crossfix verify --refuse`. No network
    and no clock take part. What a setting changes is what `crossfix diff OLD NEW` shows; the
    settings are those of `[fusion]` in a scenario. Exit code 0: written; 2: nothing was written.

    ```
    crossfix refuse recordings/strait.mcap --set association.gate=12 -o recordings/wide.mcap
    ```

    Args:
        recording: the MCAP file; one that a killed recorder left is fused as far as it goes.
        output: the new recording; nothing is overwritten.
        overrides: a setting and its new value, `key=value`; may be repeated.
        as_json: one JSON object instead of sentences.
    """
    import time

    from crossfix.reading_progress import reading
    from crossfix.refusing import refuse as fuse_again
    from schemas.recording.reader import open_recording
    from sim_world.scenario import parse_override

    changes = dict(parse_override(text) for text in overrides)
    started_s = time.monotonic()
    with open_recording(recording) as opened, reading(opened, "refuse") as show:
        refused = fuse_again(opened, output, changes, show)
    took_s = time.monotonic() - started_s
    print(_json(refused, took_s) if as_json else _told(refused, recording, took_s))


def _told(refused: Refused, recording: Path, took_s: float) -> str:
    rate = refused.span_s / took_s
    lines = [
        f"fused again: {refused.steps} steps, {refused.span_s:.0f} s in {took_s:.1f} s "
        f"({rate:.0f} x real time), {refused.outputs} outputs instead of {refused.replaced}",
        *(f"setting {c.name}: {c.before} -> {c.after}" for c in refused.settings),
        f"recording: {refused.made.path}",
        f"see what changed: crossfix diff {recording} {refused.made.path}",
    ]
    if refused.unfused:
        lines.insert(1, f"{refused.unfused} steps at the torn end lack inputs and were left out")
    return "\n".join(lines)


def _json(refused: Refused, took_s: float) -> str:
    import msgspec

    facts = refused._asdict() | {
        "took_s": took_s,
        "made": refused.made._asdict(),
        "settings": [change._asdict() for change in refused.settings],
    }
    return msgspec.json.encode(facts).decode()
