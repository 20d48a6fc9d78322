"""Golden recordings: today's code repeats their outputs, or their results have moved.

To the byte on the kind of machine that made them, within a tolerance elsewhere. If a change of
results is meant, `python -m tests.golden.make` fuses them again and tells what has moved; the
reason belongs into the message of that commit.
"""

import os
import platform
import subprocess
import sys

import pytest

from crossfix.analysis import open_recording
from crossfix.differences import EXACT, Rules
from crossfix.verification import compare, missing_inputs
from schemas import messages as m
from schemas.recording.fingerprint import numeric_fingerprint
from tests.golden.make import DURATION_S, GOLDENS, Golden

ELSEWHERE = Rules(1e-9)
"""On another kind of machine; docs/decisions/0008 says why so much."""
OLD_KERNEL = "Nehalem"  # any processor of that architecture can run it
DEADLINE_S = 120.0
MOST_BYTES = 1_000_000
by_name = pytest.mark.parametrize("golden", GOLDENS, ids=lambda golden: golden.name)


@by_name
def test_outputs_are_repeated(golden: Golden) -> None:
    with open_recording(golden.path) as recording:
        is_alike = recording.header.fingerprint == numeric_fingerprint()
        compared = compare(recording, EXACT if is_alike else ELSEWHERE)
        assert compared.difference is None
        assert compared.beyond == 0
        assert compared.equal >= DURATION_S * 3  # a correction, an association, a quality


@pytest.mark.skipif(platform.machine() != "x86_64", reason="its BLAS has no kernel of that name")
@by_name
def test_a_processor_of_another_kind_repeats_them_within_the_tolerance(golden: Golden) -> None:
    """Its BLAS adds in another order; what rounding can choose or make up would show."""
    command = ["verify", str(golden.path), "--refuse", "--tolerance", "1e-9"]
    done = subprocess.run(
        [sys.executable, "-m", "crossfix", *command],
        env={**os.environ, "OPENBLAS_CORETYPE": OLD_KERNEL, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


@by_name
def test_it_is_whole_and_small_and_has_its_truth(golden: Golden) -> None:
    with open_recording(golden.path) as recording:
        recording.check()
        assert missing_inputs(recording) == []
        assert recording.condition == ""
        assert recording.end is not None
        assert not recording.end.torn
        assert sum(1 for _ in recording.read(m.TruthCarriers)) == DURATION_S
    assert golden.path.stat().st_size < MOST_BYTES


@by_name
def test_something_is_corrected_in_it(golden: Golden) -> None:
    """A recording in which nothing happens would prove nothing."""
    with open_recording(golden.path) as recording:
        assert "applied" in {c.state for c in recording.read(m.Correction)}
