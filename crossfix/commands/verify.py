"""`crossfix verify`: is a recording whole, and does fusing it again give the same bytes?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

if TYPE_CHECKING:
    from crossfix.verification import Comparison
    from schemas.messages import StreamSpan
    from schemas.recording.reader import Recording

DIFFERENT = 1
SHOWN_CHARACTERS = 200


def verify(
    recording: Path,
    /,
    *,
    refuse: Annotated[bool, Parameter(negative="")] = False,
    tolerance: float = 0.0,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Check that a recording is whole, and that it reproduces its own outputs.

    Reads everything, holds it against every checksum, and looks for each message that the fusion
    centre says it has fused; with one of them missing nothing is fused again. Exit code 0: all is
    well; 1: the file is torn or its index damaged, an input is missing, or an output differs; 2:
    the recording cannot be read.

    ```
    crossfix verify recordings/strait.mcap --refuse
    ```

    Args:
        recording: the MCAP file.
        refuse: fuse the inputs again, in this process and without any network, and compare every
            output byte for byte with the recorded one.
        tolerance: floats of outputs count as equal that differ by no more than this, of the larger
            one where that is above 1; 1e-9 for a recording of another kind of machine.
        as_json: one JSON object instead of sentences.
    """
    from crossfix.differences import Rules
    from crossfix.making import is_torn
    from crossfix.reading_progress import reading
    from crossfix.verification import compare, missing_inputs
    from schemas.errors import CrossfixError
    from schemas.recording.reader import open_recording

    if not tolerance >= 0:
        raise CrossfixError("--tolerance", got=tolerance, expected="a number, 0 or above")
    with open_recording(recording) as opened:
        opened.check()
        missing = missing_inputs(opened)
        has_inputs = not missing or is_torn(opened)
        with reading(opened, "verify") as shown:
            comparison = compare(opened, Rules(tolerance), shown) if refuse and has_inputs else None
        notes = _notes(opened, comparison)
        is_whole = opened.index.is_whole
    show = _show_json if as_json else _show
    show(recording, is_whole, missing, comparison, notes)
    good = is_whole and not missing and not (comparison and comparison.difference)
    return 0 if good else DIFFERENT


def _notes(recording: Recording, comparison: Comparison | None) -> list[str]:
    """What one should know before one reads the verdict."""
    from schemas.recording.fingerprint import numeric_fingerprint

    notes = []
    if recording.condition:
        mended = "" if recording.index.is_whole else "; `crossfix recover` mends it"
        notes.append(recording.condition + mended)
    if count := recording.unchecked:
        notes.append(f"{count} stretches of messages have no checksum: damage in them is not seen")
    if recording.end is None:
        notes.append("the recorder left no word about its end")
    elif recording.end.torn:
        notes.append(recording.end.reason)
    if recording.end and (recording.end.dropped or recording.end.gaps):
        notes.append(f"{recording.end.dropped} messages dropped, {recording.end.gaps} never had")
    if comparison and comparison.beyond:
        notes.append(f"{comparison.beyond} outputs at the torn end were not compared")
    if comparison and comparison.difference and recording.header.made_from.get("verb") == "cut":
        notes.append(
            "cut out of a longer recording, whose past decided the outputs in it; "
            "`crossfix refuse` gives it outputs of its own"
        )
    here, there = numeric_fingerprint(), recording.header.fingerprint
    if comparison and comparison.difference and here != there:
        notes.append(f"bytes are promised on equal machines only: recorded on {there}, here {here}")
    return notes


def _show(
    path: Path,
    is_whole: bool,
    missing: list[StreamSpan],
    comparison: Comparison | None,
    notes: list[str],
) -> None:
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True)
    if is_whole:
        console.print(f"{path}: every checksum holds", markup=False)
    else:
        console.print(f"{path}: not whole; what is there holds its checksums", markup=False)
    for note in notes:
        console.print(f"note: {note}", style="yellow", markup=False)
    for span in missing:
        console.print(f"missing input: {_named(span)}", style="red", markup=False)
    if not missing:
        console.print("every input that was fused is there")
    if comparison:
        console.print(_verdict(comparison), markup=False)


def _verdict(comparison: Comparison) -> str:
    difference = comparison.difference
    if difference is None:
        if comparison.close:
            near = f"{comparison.close} of them within the tolerance, the rest to the byte"
            return f"fused again: {comparison.equal} outputs, all equal, {near}"
        return f"fused again: {comparison.equal} outputs, all equal to the byte"
    where = f"{difference.key}, step {difference.step}"
    if difference.recorded is None and not difference.field:
        return f"fused again: {where} comes out, but is not recorded"
    if difference.fused is None and not difference.field:
        return f"fused again: {where} is recorded, but does not come out"
    values = f"recorded {_short(difference.recorded)}, now {_short(difference.fused)}"
    equal = f"fused again: {comparison.equal} outputs equal"
    return f"{equal}, then {where} differs in {difference.field}: {values}"


def _show_json(
    path: Path,
    is_whole: bool,
    missing: list[StreamSpan],
    comparison: Comparison | None,
    notes: list[str],
) -> None:
    import msgspec

    facts: dict[str, Any] = {"recording": str(path), "whole": is_whole}
    facts |= {"missing": missing, "notes": notes}
    if comparison:
        difference = comparison.difference
        facts |= comparison._asdict() | {"difference": difference and difference._asdict()}
    print(msgspec.json.encode(facts).decode())


def _named(span: StreamSpan) -> str:
    return f"{span.carrier}, boot {span.boot}, {span.stream}, seq {span.first} to {span.last}"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= SHOWN_CHARACTERS else f"{text[:SHOWN_CHARACTERS]} ..."
