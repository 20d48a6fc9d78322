"""A tiny run as real processes, recorded, corrected and fused again: the whole job in small."""

from __future__ import annotations

import secrets
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from crossfix.commands.run import RunOptions
from crossfix.evaluation import FrameSummary
from crossfix.evaluation.recordings import frame_summaries
from crossfix.launch import Launch
from crossfix.running import processes
from crossfix.verification import compare
from schemas.errors import CrossfixError, LaunchError
from schemas.recording.reader import open_recording
from sim_world.scenario import load_scenario

from .finding import Finding

SCENARIO = Path(__file__).with_name("rehearsal.toml")
DEADLINE_S = 60.0
SLOW_S = 10.0
WHAT = "rehearsal"


def rehearse(endpoint: str, scenario: Path = SCENARIO, deadline_s: float = DEADLINE_S) -> Finding:
    """Run the scenario on the hub at `endpoint`, in a folder that is gone afterwards."""
    with TemporaryDirectory(prefix="crossfix-doctor-") as folder:
        recording = Path(folder) / "rehearsal.mcap"
        try:
            took_s = _run(endpoint, scenario, recording, deadline_s)
            return _judged(recording, took_s)
        except CrossfixError as error:
            advice = "the line above is of the process that failed; `crossfix run` shows them all"
            return Finding(WHAT, "bad", str(error), advice)


def _run(endpoint: str, scenario: Path, recording: Path, deadline_s: float) -> float:
    """Seconds that the run took.

    Raises:
        LaunchError: a process failed, or it did not end in time; with what was said last.
    """
    declared = load_scenario(scenario).declared
    run = f"doctor-{secrets.token_hex(4)}"
    said: list[str] = []
    started_s = time.monotonic()

    def turn() -> None:
        if time.monotonic() - started_s > deadline_s:
            raise LaunchError(f"not done in {deadline_s:g} s", where=WHAT, got=_last(said))

    with Launch(lambda name, line: said.append(f"{name}: {line}")) as all_:
        all_.start(processes(scenario, declared, run, recording, endpoint, RunOptions()))
        if code := all_.watch(turn):
            raise LaunchError(f"exit code {code} of {all_.failed}", where=WHAT, got=_last(said))
    return time.monotonic() - started_s


def _judged(path: Path, took_s: float) -> Finding:
    frames = tuple(frame_summaries(path))
    with open_recording(path) as recording:
        comparison = compare(recording)
        gaps = recording.end.gaps if recording.end else 0
    found = f"{took_s:.1f} s; {comparison.equal} outputs fused again, equal to the byte"
    if trouble := _trouble(frames, gaps) or (comparison.difference and "outputs differ"):
        advice = "this installation computes or records wrongly: report it with `doctor --json`"
        return Finding(WHAT, "bad", f"{trouble}, in {took_s:.1f} s", advice, frames)
    if took_s > SLOW_S:
        return Finding(WHAT, "warn", found, "expect slow runs: end other work here", frames)
    return Finding(WHAT, "ok", found, "", frames)


def _trouble(frames: tuple[FrameSummary, ...], gaps: int) -> str:
    """What is wrong with a run that ended well; empty if nothing is."""
    if gaps:
        return f"{gaps} messages were never recorded"
    if not frames or any(frame.state != "applied" for frame in frames):
        return "no correction was applied"
    if any(frame.after_m > frame.before_m / 2 for frame in frames):
        return "the corrections do not correct"
    return ""


def _last(said: list[str]) -> str:
    return " | ".join(said[-3:]) or "nothing"
