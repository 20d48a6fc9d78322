"""A file that MCAP records are appended to, new or already there."""

from __future__ import annotations

import os
from pathlib import Path

from ..errors import RecordingError


class PlainFile:
    """Takes whole records in their order.

    Args:
        path: must not exist, unless it `is_there`.

    Raises:
        RecordingError: it exists, or cannot be made or written to.
    """

    def __init__(self, path: Path, *, is_there: bool = False) -> None:
        flags = os.O_WRONLY | os.O_CLOEXEC | (0 if is_there else os.O_CREAT | os.O_EXCL)
        try:
            self._fd = os.open(path, flags, 0o644)
        except OSError as error:
            raise RecordingError("cannot write", where=str(path), got=error.strerror) from error
        self._name = str(path)
        self._offset = 0

    def write(self, records: bytes) -> int:
        """Append records.

        Raises:
            RecordingError: the disk does not take them.
        """
        rest = memoryview(records)
        try:
            while rest:
                rest = rest[os.write(self._fd, rest) :]
        except OSError as error:
            raise RecordingError("cannot write", where=self._name, got=error.strerror) from error
        self._offset += len(records)
        return len(records)

    def tell(self) -> int:
        """Offset of the next record."""
        return self._offset

    def flush(self) -> None:
        """Everything is with the operating system already."""

    def cut(self) -> None:
        """Nothing follows here that would have to be cut off."""

    def close(self) -> None:
        """Pass everything to the disk and give the file back."""
        os.fsync(self._fd)
        os.close(self._fd)


class KeptFile(PlainFile):
    """A file that is there: what is written to it is what it holds already, until it is cut."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, is_there=True)
        self._is_cut = False

    def write(self, records: bytes) -> int:
        """Pass over records that are there, or append new ones."""
        if self._is_cut:
            return super().write(records)
        self._offset += len(records)
        return len(records)

    def cut(self) -> None:
        """Let the file end here; what is written from now on is new."""
        os.ftruncate(self._fd, self._offset)
        os.lseek(self._fd, self._offset, os.SEEK_SET)
        self._is_cut = True


class Nowhere:
    """Takes what nobody wants."""

    def write(self, records: bytes) -> int:
        """Forget records."""
        return len(records)

    def tell(self) -> int:
        """Always the beginning."""
        return 0

    def flush(self) -> None:
        """Nothing waits."""
