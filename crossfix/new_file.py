"""Where a recording goes: a file that is not there yet, in a folder that can be written to."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryFile

from schemas.errors import LaunchError

FOLDER = Path("recordings")


def new_recording(run: str, folder: Path = FOLDER) -> Path:
    """A name for the recording of a run that no file has yet; makes the folder.

    Raises:
        LaunchError: the folder cannot be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LaunchError(
            "cannot make the folder for recordings",
            where=str(folder.absolute()),
            got=error.strerror,
            expected="to run where that is possible, or --output elsewhere",
        ) from None
    path, number = folder / f"{run}.mcap", 1
    while path.exists():
        number += 1
        path = folder / f"{run}-{number}.mcap"
    return require_new(path)


def require_new(path: Path) -> Path:
    """Return `path` if a recording can be made there: nothing is ever overwritten.

    Raises:
        LaunchError: it exists, or its folder does not or is not writable.
    """
    where, folder = str(path), path.parent
    if path.exists():
        raise LaunchError("exists already", where=where, expected="the name of a new file")
    if not folder.is_dir():
        raise LaunchError("no such folder", where=where, got=str(folder), expected="mkdir it first")
    try:
        with TemporaryFile(dir=folder):
            return path
    except OSError as error:
        raise LaunchError(
            "no file can be written there",
            where=where,
            got=error.strerror,
            expected="--output elsewhere",
        ) from None
