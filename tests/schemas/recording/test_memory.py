"""Reading takes the memory of a chunk, whatever the size of the recording."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.schemas.recording.recordings import EPOCH_NS, Written, write

READER = """
import resource, sys
from schemas.recording.reader import open_recording
with open_recording(sys.argv[1]) as recording:
    count = sum(len(message.payload) for message in recording.messages(order=sys.argv[2]))
print(count, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def peak_kib(path: Path, order: str) -> tuple[int, int]:
    """Bytes read, and the greatest resident size of the process that read them."""
    command = [sys.executable, "-c", READER, str(path), order]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    count, peak = map(int, done.stdout.split())
    return count, peak


@pytest.mark.parametrize("order", ["file", "log_time"])
@pytest.mark.parametrize("sealed", [True, False])
def test_memory_does_not_grow_with_the_file(tmp_path: Path, order: str, sealed: bool) -> None:
    peaks = []
    for count in (100, 8_000):
        path = tmp_path / f"{count}.mcap"
        payload = b"0123456789" * 1_000
        sample = Written("crossfix/@v1/r/step", payload, "application/msgpack", 0, 0, 0)
        write(path, (sample._replace(log_time_ns=EPOCH_NS + n) for n in range(count)))
        if not sealed:
            path.write_bytes(path.read_bytes()[:-40])
        read, peak = peak_kib(path, order)
        assert read == count * len(payload)
        peaks.append(peak)
    assert peaks[1] - peaks[0] < 8 * 1024  # of 80 MB
