"""`crossfix recover`: a recording whose recorder was killed gets its end, and keeps all it can."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from schemas.recording.recovery import Recovery

WHOLE, LOST = 0, 1


def recover(
    recording: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Give a recording its end and index back after its recorder was killed or lost power.

    In place: what is whole stays as it is, the torn end is cut off, and what can be had of the
    torn chunk is written anew. A file that is damaged in its midst is left alone; with `--output`
    everything good before and after goes into a new one. A recording that is whole is not touched.
    Exit code 0: it is whole now, with nothing lost but a torn end; 1: something within it was
    damaged and is lost; 2: it cannot be recovered.

    ```
    crossfix recover recordings/strait.mcap
    ```

    Args:
        recording: the MCAP file.
        output: a new file instead.
        as_json: one JSON object instead of sentences.
    """
    from crossfix.making import beside
    from schemas.recording.recovery import recover as mend

    if output is None:
        found = mend(recording)
    else:
        with beside(output) as unfinished:
            found = mend(recording, unfinished)._replace(path=str(output))
    print(_json(found) if as_json else _told(found))
    return LOST if found.damage else WHOLE


def _told(found: Recovery) -> str:
    if found.was_whole:
        return f"{found.path}: whole, {found.messages} messages; nothing to do"
    lines = [
        f"{found.path}: {found.messages} messages, {found.salvaged} of them out of a torn chunk; "
        f"{found.bytes_before} bytes became {found.bytes_after}",
        *(f"lost: {what}" for what in found.damage),
    ]
    return "\n".join(lines)


def _json(found: Recovery) -> str:
    import msgspec

    return msgspec.json.encode(found._asdict()).decode()
