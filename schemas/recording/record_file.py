"""The file under the MCAP writer: it ends with a whole record, also when the disk is full."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import IO, Literal

from mcap.opcode import Opcode

RESERVE_BYTES = 4 * 1024 * 1024
Fsync = Literal["none", "flush", "end"]
"""When to wait until the disk has what the operating system was given."""


class RecordFile:
    """Passes records to the operating system at once and cuts off what it could not take whole.

    A reserve of disk space, held in a file without a name (which the system frees should the
    process die), is let go at the first error; the record is then tried once more. So a full disk
    costs nothing of what was accepted, and the file can still be sealed.

    Attributes:
        offset: bytes in the file, all of them whole records.
        chunks: MCAP chunks among them.
        error: the first error the disk gave, if the reserve has saved the day since.
    """

    def __init__(self, path: Path, *, fsync: Fsync, reserve_bytes: int) -> None:
        self.offset = self.chunks = 0
        self.error: OSError | None = None
        self._path, self._fsync = path, fsync
        self._reserve: IO[bytes] | None = None
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        try:
            self._reserve = _allocated(path.parent, reserve_bytes)
        except OSError:
            self.close()
            path.unlink()
            raise

    def write(self, records: bytes) -> int:
        """Append whole records.

        Raises:
            OSError: the disk does not take them; the file ends as before the call.
        """
        try:
            self._append(records)
        except OSError as error:
            if self._reserve is None:
                raise
            self.error = error
            self._release()
            self._append(records)
        self.chunks += records[:1] == _CHUNK
        return len(records)

    def tell(self) -> int:
        """Offset of the next record."""
        return self.offset

    def flush(self) -> None:
        """Everything is with the operating system already; with `fsync` also on the disk."""
        if self._fsync == "flush":
            os.fsync(self._fd)

    def finish(self) -> None:
        """Wait, unless nobody wants to, until the disk has the file and its name.

        Raises:
            OSError: it does not take them.
        """
        if self._fsync != "none":
            os.fsync(self._fd)
            folder = os.open(self._path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)

    def cut(self, offset: int) -> None:
        """Let the file end at `offset`."""
        os.ftruncate(self._fd, offset)
        os.lseek(self._fd, offset, os.SEEK_SET)
        self.offset = offset

    def close(self) -> None:
        """Give back file and reserve."""
        self._release()
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)

    def _append(self, records: bytes) -> None:
        rest = memoryview(records)
        try:
            while rest:
                rest = rest[os.write(self._fd, rest) :]
        except OSError:
            self.cut(self.offset)
            raise
        self.offset += len(records)

    def _release(self) -> None:
        if self._reserve is not None:
            self._reserve.close()
            self._reserve = None


_CHUNK = bytes([Opcode.CHUNK])


def _allocated(directory: Path, count: int) -> IO[bytes]:
    file = tempfile.TemporaryFile(dir=directory, buffering=0)  # noqa: SIM115 - held on to
    try:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, max(count, 1))
        else:
            file.write(os.urandom(count))
    except OSError:
        file.close()
        raise
    return file
