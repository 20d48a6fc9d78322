"""What the corrections of a recording did, as a table for people or as JSON."""

from __future__ import annotations

import json
from math import degrees, isnan
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from schemas import keys
from schemas.messages import Correction, DeclaredScenario, TruthCarriers
from schemas.recording.reader import open_recording

from .evaluation import FrameSummary, frame_errors, summarise

NOTE = (
    "Root mean squares over the second half of the run. Own axes: the other carrier as the own "
    "one's sensors see it. Fixed axes: towards true north, where a common rotation of both norths "
    "cannot be observed and leaves a floor. NEES/dim of an honest sigma is 1."
)


def show_frames(path: Path, *, as_json: bool = False) -> list[FrameSummary]:
    """Print the error of every carrier's frame before and after correction."""
    summaries = frame_summaries(path)
    if as_json:
        print(json.dumps([summary._asdict() for summary in summaries], indent=2))
    else:
        _print(summaries)
    return summaries


def frame_summaries(path: Path) -> list[FrameSummary]:
    """Errors of every carrier's frame; empty where the recording holds no truth."""
    with open_recording(path) as recording:
        scenario = recording.scenario
        messages = [
            message.decode()
            for message in recording.messages(topics=(keys.TRUTH_CARRIERS, keys.CORRECTION))
        ]
    corrections = [m for m in messages if isinstance(m, Correction)]
    wanted = [m for m in messages if isinstance(m, TruthCarriers | Correction)]
    errors = frame_errors(scenario, own_carrier(scenario), wanted)
    last = {correction.carrier: correction for correction in corrections}
    return [summarise(name, errors.get(name, []), last[name]) for name in sorted(last)]


def own_carrier(scenario: DeclaredScenario) -> str:
    """The carrier whose axes the picture is in."""
    return str(scenario.fusion.get("own") or scenario.carriers[0].name)


def _print(summaries: list[FrameSummary]) -> None:
    table = Table(
        title="Error of each carrier's frame, before -> after correction",
        caption=NOTE,
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
    )
    table.add_column("carrier", no_wrap=True)
    table.add_column("state", no_wrap=True)
    for heading in (
        "own axes\n[m]", "sigma\n[m]", "fixed axes\n[m]", "north\n[deg]", "sigma\n[deg]",
        "NEES\n/dim", "targets\nused",
    ):  # fmt: skip
        table.add_column(Text(heading), justify="right", no_wrap=True)
    for s in summaries:
        table.add_row(
            s.carrier,
            s.state,
            _change(s.before_m, s.after_m, ".0f"),
            f"{s.sigma_m:.0f}",
            _change(s.fixed_before_m, s.fixed_after_m, ".0f"),
            _change(degrees(s.before_rad), degrees(s.after_rad), ".2f"),
            f"{degrees(s.sigma_rad):.2f}",
            f"{s.nees / 3:.2f}",
            f"{s.pairs:.1f}",
        )
    console = Console()
    console.print(table, highlight=False)
    for s in summaries:
        if s.reason:
            console.print(f"{s.carrier}: {s.reason}", highlight=False)


def _change(before: float, after: float, form: str) -> str:
    if isnan(before):
        return "-"
    return f"{before:{form}} -> {after:{form}}"
