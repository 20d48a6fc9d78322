"""kill -9 of a recording process costs what the last flush left out, and nothing before it."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from schemas.recording.reader import open_recording

MAX_LOSS_S = 0.25
WRITER = """
import sys, time
from pathlib import Path
from schemas import keys
from schemas.recording.writer import RecordingWriter
from tests.schemas.recording.recordings import HEADER
key, started = keys.NAVIGATION.key("strait", "alpha"), time.monotonic_ns()
longest_pause_ns, before_ns = 0, started
with RecordingWriter(Path(sys.argv[1]), HEADER, max_loss_s=0.25) as writer:
    for seq in range(1, 10**9):
        now_ns = time.monotonic_ns()
        longest_pause_ns, before_ns = max(longest_pause_ns, now_ns - before_ns), now_ns
        at_ns = now_ns - started
        writer.write(key, b"x" * 174, "application/msgpack", log_time_ns=at_ns,
                     publish_time_ns=at_ns, sequence=seq)
        writer.tick(time.monotonic())
        print(seq, at_ns, longest_pause_ns, flush=True)
        time.sleep(0.0005)
"""


def kill_after(path: Path, run_ns: int) -> tuple[int, int, int]:
    """Let it write for a while, kill it; its last message: seq, time, longest pause till then."""
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        line = "0 0 0"
        for line in process.stdout:
            if int(line.split()[1]) >= run_ns:
                break
        process.send_signal(signal.SIGKILL)
        rest = [text for text in process.stdout.read().split("\n") if text.count(" ") == 2]
        seq, at_ns, pause_ns = map(int, (rest[-1] if rest else line).split())
        return seq, at_ns, pause_ns


def loses_little(path: Path, seed: int) -> None:
    rng = random.Random(seed)
    last_seq, last_ns, pause_ns = kill_after(path, rng.randrange(400_000_000, 1_200_000_000))
    with open_recording(path) as recording:
        assert recording.condition.startswith("unfinished")
        assert recording.end is None
        found = list(recording.messages())
    assert [message.sequence for message in found] == list(range(1, len(found) + 1))
    assert len(found) <= last_seq + 1  # the last one may have been flushed before it was printed
    lost_s = (last_ns - found[-1].publish_time_ns) / 1e9
    assert lost_s <= MAX_LOSS_S + 0.05 + pause_ns / 1e9  # a pause of the process is not the file's


@pytest.mark.parametrize("seed", range(3))
def test_a_killed_writer_leaves_a_gapless_prefix(tmp_path: Path, seed: int) -> None:
    loses_little(tmp_path / "run.mcap", seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3, 23))
def test_twenty_killed_writers_of_twenty(tmp_path: Path, seed: int) -> None:
    loses_little(tmp_path / "run.mcap", seed)
