"""Where a recording goes: a file that is not there yet, in a folder that can be written to."""

from __future__ import annotations

import socket
import sys
from hashlib import blake2b
from pathlib import Path
from tempfile import TemporaryFile

from schemas.errors import LaunchError

FOLDER = Path("recordings")
_HELD: list[socket.socket] = []
"""Names that this process has chosen, until its end."""


def new_recording(run: str, folder: Path = FOLDER) -> Path:
    """A name for the recording of a run that no file has yet; makes the folder.

    Until this process ends nobody else is given the name, though its file comes later.

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
    while path.exists() or not _held(path):
        number += 1
        path = folder / f"{run}-{number}.mcap"
    return require_new(path)


def require_new(path: Path) -> Path:
    """Return `path` if a recording can be made there: nothing is ever overwritten.

    Raises:
        LaunchError: it exists, or its folder does not or is not writable.
    """
    if path.exists():
        raise LaunchError("exists already", where=str(path), expected="the name of a new file")
    return require_writable(path)


def require_writable(path: Path) -> Path:
    """Return `path` if its folder takes new files.

    Raises:
        LaunchError: there is no such folder, or it is not writable.
    """
    where, folder = str(path), path.parent
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


def _held(path: Path) -> bool:
    """Take a name for ourselves, beyond `execve` too; false if another process has it.

    Sockets in Linux' abstract namespace are let go of however their process ends, and leave no
    file. Elsewhere two runs may choose one name, and the recorder of the second refuses it.
    """
    if not sys.platform.startswith("linux"):
        return True
    digest = blake2b(bytes(path.absolute()), digest_size=16).hexdigest()
    name = socket.socket(socket.AF_UNIX)
    try:
        name.bind(f"\0crossfix-recording-{digest}")
    except OSError:
        name.close()
        return False
    name.set_inheritable(True)
    _HELD.append(name)
    return True
