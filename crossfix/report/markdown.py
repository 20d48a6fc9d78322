"""The figures of a recording as a page of Markdown, for an issue, a log or a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from crossfix.quantities import degrees, metres, quantity, seconds
from crossfix.table import (
    ALIGNMENT_NOTE,
    NOTE,
    PICTURE_HEADINGS,
    PICTURE_NOTE,
    alignment_rows,
    applies,
    picture_cells,
)

from .figures import CarrierFigures, Figures, TruthFigures
from .words import (
    COUNTED,
    SOURCE_HEADINGS,
    SOURCES_NOTE,
    duration,
    instant,
    losses,
    size,
    source_cells,
)


def markdown_page(figures: Figures) -> str:
    """The whole page."""
    return "\n".join(_lines(figures)) + "\n"


def _lines(f: Figures) -> Iterator[str]:
    yield f"# {_plain(f.title)}"
    yield ""
    yield (
        f"Run {f.run} of scenario {f.scenario}: {f.steps} of {f.steps_declared} steps over "
        f"{duration(f.duration_s)}, seen from {f.own}. "
        f"Recorded {instant(f.recorded_ns)}; {_plain(f.ending)}."
    )
    yield ""
    for notice in f.notices:
        yield f"> {_plain(notice)}"
        yield ""
    yield from _corrections(f)
    yield from _alignment(f)
    yield from _picture(f)
    yield from _sources(f)
    yield from _losses(f)
    yield from _run(f)


def _corrections(f: Figures) -> Iterator[str]:
    yield "## Corrections"
    yield ""
    if not f.carriers:
        yield "The recording holds no correction of any carrier."
    elif f.has_truth:
        yield NOTE
        yield ""
        errors = ("carrier", "error of", "before", "after", "sigma", "NEES/dim", "targets")
        yield from _table(errors, [row for c in f.carriers for row in _against_truth(c)])
    else:
        claims = ("carrier", "moved", "sigma", "turned", "sigma", "targets")
        yield from _table(claims, [_claimed(c) for c in f.carriers])
    yield ""
    for c in f.carriers:
        applied = "never applied" if c.applied_after_s is None else (
            f"first applied after {seconds(c.applied_after_s)}"
        )  # fmt: skip
        yield f"- {c.name}: {c.state}, {applied}{_plain(f' ({c.reason})' if c.reason else '')}"
        if c.applies:
            yield f"- {c.name} {applies(c.said_m)}"
    yield ""


def _against_truth(c: CarrierFigures) -> list[tuple[str, ...]]:
    t: TruthFigures | None = c.truth
    if t is None:
        return [(c.name, *["-"] * 6)]
    nees, targets = quantity(t.nees_per_dimension, ".2f"), quantity(c.pairs, ".1f")
    own = (metres(t.before_m), metres(t.after_m), metres(t.sigma_m))
    fixed = (metres(t.fixed_before_m), metres(t.fixed_after_m))
    north = (degrees(t.before_rad), degrees(t.after_rad), degrees(t.sigma_rad))
    return [
        (c.name, "place, own axes", *own, nees, targets),
        ("", "place, fixed axes", *fixed, "", "", ""),
        ("", "north", *north, "", ""),
    ]


def _claimed(c: CarrierFigures) -> tuple[str, ...]:
    moved = (metres(c.moved_m), metres(c.sigma_m))
    turned = (degrees(c.turned_rad), degrees(c.sigma_rad))
    return (c.name, *moved, *turned, quantity(c.pairs, ".1f"))


def _picture(f: Figures) -> Iterator[str]:
    if f.picture is None:
        return
    yield "## Picture"
    yield ""
    p = f.picture
    yield f"{p.tracks} tracks at the end; {p.objects:.1f} objects, sigma {p.sigma_objects:.2g}."
    yield ""
    if f.picture.truth is not None:
        yield PICTURE_NOTE
        yield ""
        yield from _table(PICTURE_HEADINGS, [picture_cells(f.picture.truth)])
        yield ""


def _alignment(f: Figures) -> Iterator[str]:
    if not f.alignment:
        return
    yield "## Carriers by beacons and ranges"
    yield ""
    yield ALIGNMENT_NOTE
    yield ""
    headings = ("carrier", "error of", "reported", "found", "sigma", "NEES/dim")
    yield from _table(headings, [row for c in f.alignment for row in alignment_rows(c)])
    yield ""
    for b in f.beacons:
        yield (
            f"- beacon {b.beacon}: {metres(b.declared_m)} astray as declared, "
            f"{metres(b.found_m)} as found, sigma {metres(b.sigma_m)}"
        )
    for c in f.alignment:
        if c.unobservable:
            yield f"- {c.carrier}: not observable: {_plain(', '.join(c.unobservable))}"
    yield ""


def _sources(f: Figures) -> Iterator[str]:
    if not f.sources:
        return
    yield "## Sources"
    yield ""
    yield SOURCES_NOTE
    yield ""
    rows = [(s.carrier, s.source, *source_cells(s)) for s in f.sources]
    yield from _table(("carrier", "source", *SOURCE_HEADINGS), rows)
    yield ""


def _losses(f: Figures) -> Iterator[str]:
    yield "## Losses and health"
    yield ""
    found = losses(f.losses)
    yield f"Lost: {found}." if found else "Nothing was lost."
    yield ""
    if f.losses.streams:
        rows = [
            (s.carrier, s.stream, *(str(getattr(s, name)) for name in COUNTED))
            for s in f.losses.streams
        ]
        yield from _table(("carrier", "stream", *COUNTED.values()), rows)
        yield ""
    for item in f.news:
        yield f"- {seconds(item.t_s)}: {_plain(item.text)}"
    for flag, count in f.losses.flags.items():
        yield f"- {count} times, {_plain(flag)}"
    yield ""


def _run(f: Figures) -> Iterator[str]:
    yield "## Run"
    yield ""
    t = f.timing
    yield (
        f"- pace: {quantity(t.steps_per_s, '.1f', ' steps/s')} over "
        f"{quantity(t.wall_s, '.1f', ' s')}, slowest {quantity(t.slowest_steps_per_s, '.1f')}"
    )
    yield f"- recording: {_plain(f.recording)}, {size(f.bytes)}, {f.messages} messages"
    yield "- versions: " + ", ".join(f"{name} {number}" for name, number in f.versions.items())
    p = f.fingerprint
    yield f"- fingerprint: numpy {p.numpy}, {p.blas}, {p.simd}, {p.machine}, {p.libc}"


def _table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    yield _row(headings)
    yield _row(["---"] * len(headings))
    for row in rows:
        yield _row([_plain(cell) for cell in row])


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _plain(text: str) -> str:
    """Text of others as one line in which nothing is markup."""
    line = " ".join(text.split())
    return "".join(f"\\{c}" if c in "\\`*_[]<>|#" else c for c in line)
