"""What a run has found, against the truth in its recording, as tables for people or as JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from math import isnan
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from .evaluation import CUTOFF_M, AlignmentSummary, FrameSummary, PictureSummary
from .evaluation.recordings import (
    WholeAlignment,
    alignment_summary,
    frame_summaries,
    picture_summary,
)
from .quantities import degrees, metres, quantity, three_digits

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

ALIGNMENT_NOTE = (
    "Root mean squares over the second half of the run, along true north. Clocks are counted from "
    "the own one."
)

MOST_COLUMNS = 1000

PICTURE_HEADINGS = (
    "targets", "tracks", "missed", "false", "GOSPA", "error", "NEES/dim", "names changed"
)  # fmt: skip


def show_results(path: Path, *, as_json: bool = False) -> None:
    """Print what can be held against the truth: frames, alignment, picture, where there are any.

    JSON has the frames alone; all figures are in `crossfix report --json`.
    """
    frames = frame_summaries(path)
    if as_json:
        print(json.dumps([summary._asdict() for summary in frames], indent=2))
        return
    if frames:
        print_frames(frames)
    print_alignment(alignment_summary(path))
    if (picture := picture_summary(path)) is not None and picture.targets + picture.tracks:
        print_picture(picture)


def print_frames(summaries: list[FrameSummary]) -> None:
    """Print them as a table for people."""
    table = _table("Error of each carrier's frame before and after correction", NOTE)
    _add_errors(table, "carrier", "before", "after")
    for s in summaries:
        if isnan(s.before_m):  # of a stranger nobody knows the truth
            table.add_row(s.carrier, s.state, end_section=True)
            continue
        place = metres(s.before_m), metres(s.after_m)
        fixed = metres(s.fixed_before_m), metres(s.fixed_after_m)
        north = _degrees(s.before_rad), _degrees(s.after_rad)
        nees = quantity(s.nees / 3, ".2f")
        table.add_row(s.carrier, "place, own axes", *place, metres(s.sigma_m), nees)
        table.add_row(s.state, "place, fixed axes", *fixed)
        targets = quantity(s.pairs, ".1f", " targets")
        table.add_row(targets, "north", *north, _degrees(s.sigma_rad), end_section=True)
    _show(table)
    console = Console()
    for s in summaries:
        if s.reason:
            console.print(f"{s.carrier}: {s.reason}", highlight=False)
        if not isnan(s.said_m):
            console.print(f"{s.carrier} {applies(s.said_m)}", highlight=False)


def applies(said_m: float | None) -> str:
    """That a carrier applies its corrections, in words, and what comes of it."""
    if said_m is None or isnan(said_m):
        return "applies its corrections"
    return f"applies its corrections: the place it reports then errs by {metres(said_m)}"


def print_alignment(alignment: WholeAlignment) -> None:
    """Print carriers and beacons as tables for people; nothing where there are none."""
    console = Console()
    if alignment.carriers:
        table = _table("Carriers by beacons and ranges", ALIGNMENT_NOTE)
        _add_errors(table, "carrier", "reported", "found")
        for s in alignment.carriers:
            for row in alignment_rows(s, _degrees):
                table.add_row(*row)
            table.add_section()
        _show(table)
    if alignment.beacons:
        table = _table("Beacons at the end", "")
        table.add_column("beacon", no_wrap=True)
        for heading in ("error as declared", "as found", "sigma"):
            table.add_column(heading, justify="right", no_wrap=True)
        for b in alignment.beacons:
            table.add_row(b.beacon, metres(b.declared_m), metres(b.found_m), metres(b.sigma_m))
        _show(table)
    for words in not_observable(alignment):
        console.print(words, highlight=False)


def not_observable(alignment: WholeAlignment) -> list[str]:
    """What ranges have left open, as sentences."""
    return [
        f"{carrier.carrier}: not observable: {', '.join(carrier.unobservable)}"
        for carrier in alignment.carriers
        if carrier.unobservable
    ]


def alignment_rows(
    s: AlignmentSummary, angle: Callable[[float], str] = degrees
) -> Sequence[tuple[str, ...]]:
    """Rows of carrier, what, reported, found, sigma, NEES/dim; known constants have none."""
    nees = quantity(s.nees_per_dimension, ".2f")
    place = metres(s.reported_m), metres(s.found_m)
    rows = [(s.carrier, "place", *place, metres(s.sigma_m), nees)]
    names = iter([s.status, f"{s.ranges} ranges"])
    if s.sigma_rad > 0:
        north = angle(s.reported_rad), angle(s.found_rad)
        rows.append((next(names), "north", *north, angle(s.sigma_rad), ""))
    if s.sigma_s > 0:
        clock = _seconds(s.reported_s), _seconds(s.found_s)
        rows.append((next(names), "clock", *clock, _seconds(s.sigma_s), ""))
    return rows


def print_picture(picture: PictureSummary) -> None:
    """Print it as a table for people."""
    table = _table("Picture against the truth", PICTURE_NOTE)
    for heading in PICTURE_HEADINGS:
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_row(*picture_cells(picture))
    _show(table)


def picture_cells(picture: PictureSummary) -> tuple[str, ...]:
    """The row under `PICTURE_HEADINGS`."""
    return (
        quantity(picture.targets, ".1f"),
        quantity(picture.tracks, ".1f"),
        quantity(picture.missed, ".2f"),
        quantity(picture.false, ".2f"),
        metres(picture.gospa_m),
        metres(picture.error_m),
        quantity(picture.nees_per_dimension, ".2f"),
        str(picture.identity_changes),
    )


def _table(title: str, note: str) -> Table:
    return Table(
        title=title,
        caption=note or None,
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 0, 0, 1),
        pad_edge=False,
    )


def _show(table: Table) -> None:
    """Print it as wide as its figures are, whatever the terminal: none is cut short."""
    console = Console()
    unbounded = console.options.update(max_width=MOST_COLUMNS)
    console.width = max(console.width, Measurement.get(console, unbounded, table).maximum)
    console.print(table, highlight=False)


def _add_errors(table: Table, whose: str, before: str, after: str) -> None:
    for heading in (whose, "error of"):
        table.add_column(heading, no_wrap=True)
    for heading in (before, after, "sigma", "NEES/dim"):
        table.add_column(heading, justify="right", no_wrap=True)


def _degrees(radians: float) -> str:
    return degrees(radians, " deg")


def _seconds(span_s: float) -> str:
    return three_digits(span_s, " s")
