"""`crossfix merge`: recordings of one run as one, in order of time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def merge(
    *recordings: Path,
    output: Annotated[Path, Parameter(alias="-o")],
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> None:
    """Put recordings of one run together, such as those of two recorders or of several keys.

    Messages come in order of log time; what several recordings hold is there once. Recordings of
    different runs, or that disagree about a message, are refused. For the parts of a split
    recording, `crossfix cat` is quicker. Exit code 0: written; 2: nothing was written.

    ```
    crossfix cut recordings/strait.mcap --role truth -o recordings/truth.mcap
    crossfix cut recordings/strait.mcap --role input -o recordings/inputs.mcap
    crossfix merge recordings/truth.mcap recordings/inputs.mcap -o recordings/both.mcap
    ```

    Args:
        recordings: two or more MCAP files.
        output: the new recording; nothing is overwritten.
        as_json: one JSON object instead of a sentence.
    """
    from contextlib import ExitStack

    import msgspec

    from crossfix.joining import merge as put_together
    from crossfix.reading_progress import reading
    from schemas.errors import CrossfixError
    from schemas.recording.reader import open_recording

    if len(recordings) < 2:
        raise CrossfixError(
            "nothing to merge with", got=len(recordings), expected="two recordings or more"
        )
    with ExitStack() as stack:
        opened = [stack.enter_context(open_recording(path)) for path in recordings]
        show = stack.enter_context(reading(opened[0], "merge"))
        done = put_together(opened, output, [path.name for path in recordings], show)
    if as_json:
        facts = done._asdict() | {"made": done.made._asdict()}
        print(msgspec.json.encode(facts).decode())
        return
    print(f"recording: {output}, {done.made.messages} messages, {done.repeated} had twice")
