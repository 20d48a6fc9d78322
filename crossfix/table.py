"""What the corrections of a recording did, as a table for people or as JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from math import degrees, isnan, nan
from pathlib import Path
from typing import cast

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from schemas import keys
from schemas.messages import Correction, DeclaredScenario, Navigation, TruthCarriers
from schemas.recording.reader import open_recording

from .evaluation import FrameSummary, frame_errors, said_errors, summarise
from .tracking_errors import CUTOFF_M, Known, PictureSummary, picture_errors, summarise_picture

NOTE = (
    "Root mean squares over the second half of the run, when it has converged. Own axes: the other "
    "carrier as the own one's sensors see it. Fixed axes: to true north; both norths turned "
    "together cannot be observed there and leave a floor. An honest sigma has NEES/dim 1."
)

PICTURE_NOTE = (
    "Means over the second half of the run, in the axes the own carrier believes in. GOSPA with "
    f"p = 2 and c = {CUTOFF_M:.0f} m: a track farther than that from every target is false. "
    "Error: root mean square of the tracks' places."
)

PICTURE_HEADINGS = (
    "targets", "tracks", "missed", "false", "GOSPA", "error", "NEES/dim", "names changed"
)  # fmt: skip

DIMENSIONS = 2
"""Of a place in the picture."""

NOTHING = 1e-6
"""An error below this [m, rad] is none: known frames have no ratio."""


def show_frames(path: Path, *, as_json: bool = False) -> list[FrameSummary]:
    """Print the error of every carrier's frame before and after correction, and the picture's.

    JSON has the frames alone; the picture is among the figures of `crossfix report --json`.
    """
    summaries = frame_summaries(path)
    if as_json:
        print(json.dumps([summary._asdict() for summary in summaries], indent=2))
    else:
        print_frames(summaries)
        if (picture := picture_summary(path)) is not None:
            print_picture(picture)
    return summaries


def frame_summaries(path: Path) -> list[FrameSummary]:
    """Errors of every carrier's frame; empty where the recording holds no truth."""
    with open_recording(path) as recording:
        scenario = recording.scenario
        messages = [message.decode() for message in recording.messages(topics=_FRAMES)]
    corrections = [m for m in messages if isinstance(m, Correction)]
    wanted = [m for m in messages if isinstance(m, TruthCarriers | Correction)]
    errors = frame_errors(scenario, own_carrier(scenario), wanted)
    last = {correction.carrier: correction for correction in corrections}
    told = [m for m in messages if isinstance(m, TruthCarriers | Navigation)]
    said = said_errors(scenario, own_carrier(scenario), sorted(told, key=_time))
    return [
        summarise(name, errors.get(name, []), last[name], said.get(name, ()))
        for name in sorted(last)
    ]


_FRAMES = (keys.TRUTH_CARRIERS, keys.CORRECTION, keys.NAVIGATION)


def _time(message: TruthCarriers | Navigation) -> int:
    return message.t_ns


def picture_summary(path: Path) -> PictureSummary | None:
    """The picture against the truth; None where the recording lacks either."""
    wanted = (keys.TRUTH_TARGETS, keys.TRUTH_CARRIERS, keys.NAVIGATION, keys.TRACK)
    with open_recording(path) as recording:
        scenario = recording.scenario
        known = (message.decode() for message in recording.messages(topics=wanted))
        messages = cast("Iterable[Known]", known)
        return summarise_picture(picture_errors(scenario, own_carrier(scenario), messages))


def own_carrier(scenario: DeclaredScenario) -> str:
    """The carrier whose axes the picture is in."""
    return str(scenario.fusion.get("own") or scenario.carriers[0].name)


def print_frames(summaries: list[FrameSummary]) -> None:
    """Print them as a table for people."""
    table = Table(
        title="Error of each carrier's frame before and after correction",
        caption=NOTE,
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 0, 0, 1),
        pad_edge=False,
    )
    for heading in ("carrier", "error of"):
        table.add_column(heading, no_wrap=True)
    for heading in ("before", "after", "ratio", "sigma", "NEES/dim"):
        table.add_column(heading, justify="right", no_wrap=True)
    for s in summaries:
        place = _change(s.before_m, s.after_m, _metres)
        fixed = _change(s.fixed_before_m, s.fixed_after_m, _metres)
        north = _change(s.before_rad, s.after_rad, _degrees)
        nees = _number(s.nees / 3, ".2f")
        table.add_row(s.carrier, "place, own axes", *place, _metres(s.sigma_m), nees)
        table.add_row(s.state, "place, fixed axes", *fixed)
        targets = _number(s.pairs, ".1f", " targets")
        table.add_row(targets, "north", *north, _degrees(s.sigma_rad), end_section=True)
    console = Console()
    console.print(table, highlight=False)
    for s in summaries:
        if s.reason:
            console.print(f"{s.carrier}: {s.reason}", highlight=False)
        if not isnan(s.said_m):
            console.print(f"{s.carrier} {applies(s.said_m)}", highlight=False)


def applies(said_m: float) -> str:
    """That a carrier applies its corrections, in words, and what comes of it."""
    return f"applies its corrections: the place it reports then errs by {_metres(said_m)}"


def print_picture(picture: PictureSummary) -> None:
    """Print it as a table for people."""
    table = Table(
        title="Picture against the truth",
        caption=PICTURE_NOTE,
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 0, 0, 1),
        pad_edge=False,
    )
    for heading in PICTURE_HEADINGS:
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_row(*picture_cells(picture))
    Console().print(table, highlight=False)


def picture_cells(picture: PictureSummary) -> tuple[str, ...]:
    """The row under `PICTURE_HEADINGS`."""
    return (
        _number(picture.targets, ".1f"),
        _number(picture.tracks, ".1f"),
        _number(picture.missed, ".2f"),
        _number(picture.false, ".2f"),
        _number(picture.gospa_m, ".1f", " m"),
        _number(picture.error_m, ".1f", " m"),
        _number(picture.nees / DIMENSIONS, ".2f"),
        str(picture.identity_changes),
    )


def _change(before: float, after: float, told: Callable[[float], str]) -> tuple[str, str, str]:
    ratio = after / before if before > NOTHING else nan
    return told(before), told(after), _number(ratio, ".3f")


def _metres(metres: float) -> str:
    return _number(metres, ".0f", " m")


def _degrees(radians: float) -> str:
    return _number(degrees(radians), ".2f", " deg")


def _number(value: float, form: str, unit: str = "") -> str:
    return "-" if isnan(value) else f"{value:{form}}{unit}"
