"""`crossfix cat`: recordings one behind the other, as lines of JSON or as one recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from crossfix.commands import Keys
from crossfix.commands.diff import RoleName

if TYPE_CHECKING:
    from crossfix.selecting import Selection


def cat(
    *recordings: Path,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    start: float = 0.0,
    until: float | None = None,
    role: Annotated[tuple[RoleName, ...], Parameter(negative="")] = (),
    keys: Keys = (),
    without: Keys = (),
) -> None:
    """Print the messages of recordings as lines of JSON, or write parts of a recording as one.

    Each line holds key, role, times and the message, so that `jq` and the like can go on from
    there. With `--output` the recordings are written one behind the other: parts that a recorder
    has split, in their order. Exit code 0: done; 2: something cannot be read or written.

    ```
    crossfix cat recordings/strait.mcap --keys 'correction/**' --until 3
    ```

    Args:
        recordings: one or more MCAP files.
        output: a new recording instead of lines; nothing is overwritten.
        start: of each, seconds after its first message.
        until: of each, seconds after its first message.
        role: only messages of this role; may be repeated.
        keys: only keys after the run like this, such as `report/**`; may be repeated.
        without: no keys after the run like this; may be repeated.
    """
    from crossfix.selecting import EVERYTHING, Selection
    from schemas.errors import CrossfixError
    from schemas.keys import Role

    selection = Selection(start, until, tuple(Role(one) for one in role), keys, without)
    if not recordings:
        raise CrossfixError("nothing to read", expected="at least one recording")
    if output is None:
        _print(recordings, selection)
    elif selection == EVERYTHING:
        _write(recordings, output)
    else:
        raise CrossfixError("--output takes all of each part", expected="crossfix cut for a part")


def _print(recordings: tuple[Path, ...], selection: Selection) -> None:
    import os
    import sys

    from crossfix.lines import lines_of
    from crossfix.selecting import selected
    from schemas.recording.reader import open_recording

    try:
        for path in recordings:
            with open_recording(path) as opened:
                for line in lines_of(selected(opened, selection)):
                    sys.stdout.write(line)
        sys.stdout.flush()
    except BrokenPipeError:  # whoever reads has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _write(recordings: tuple[Path, ...], output: Path) -> None:
    from contextlib import ExitStack

    from crossfix.joining import join
    from crossfix.reading_progress import reading
    from schemas.recording.reader import open_recording

    with ExitStack() as stack:
        opened = [stack.enter_context(open_recording(path)) for path in recordings]
        show = stack.enter_context(reading(opened[0], "cat"))
        done = join(opened, output, [path.name for path in recordings], show)
    print(f"recording: {output}, {done.made.messages} messages, {done.repeated} had twice")
