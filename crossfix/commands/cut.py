"""`crossfix cut`: a part of a recording as a recording of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from crossfix.commands import Keys
from crossfix.commands.diff import RoleName


def cut(
    recording: Path,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o")],
    start: float = 0.0,
    until: float | None = None,
    role: Annotated[tuple[RoleName, ...], Parameter(negative="")] = (),
    keys: Keys = (),
    without: Keys = (),
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> None:
    """Write a part of a recording, by time, role and key, as one that stands alone.

    What is latched at the beginning comes with it, and so do scenario, truth and schemas. Where
    inputs are left out, the closings that name them say so; `crossfix refuse` then shows what
    would have been fused without them. Exit code 0: written; 2: nothing was written.

    ```
    crossfix cut recordings/strait.mcap --start 1 --until 4 -o recordings/three-seconds.mcap
    crossfix cut recordings/strait.mcap --without 'report/b/radar' -o recordings/blind.mcap
    ```

    Args:
        recording: the MCAP file.
        output: the new recording; nothing is overwritten.
        start: seconds after the first message; this instant is in the part.
        until: seconds after the first message; this instant is not in the part.
        role: only messages of this role; may be repeated.
        keys: only keys after the run like this, such as `report/**`; may be repeated.
        without: no keys after the run like this; may be repeated.
        as_json: one JSON object instead of a sentence.
    """
    import msgspec

    from crossfix.cutting import cut as cut_out
    from crossfix.reading_progress import reading
    from crossfix.selecting import Selection
    from schemas.keys import Role
    from schemas.recording.reader import open_recording

    selection = Selection(start, until, [Role(one) for one in role], keys, without)
    with open_recording(recording) as opened, reading(opened, "cut") as show:
        done = cut_out(opened, output, selection, show)
    if as_json:
        facts = done._asdict() | {"made": done.made._asdict()}
        print(msgspec.json.encode(facts).decode())
        return
    print(f"recording: {output}, {done.made.messages} messages, {done.left_out} left out")
    if done.restated:
        print(f"{done.restated} closings now give up what is left out: crossfix refuse {output}")
