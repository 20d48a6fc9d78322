"""The report of a recording, in its three forms."""

from __future__ import annotations

from pathlib import Path

import msgspec

from crossfix.new_file import require_writable
from schemas.errors import CrossfixError

from . import require_bokeh
from .figures import Figures, figures_of
from .markdown import markdown_page
from .series import frame_series
from .story import read_story


def write_page(recording: Path, output: Path) -> Figures:
    """Draw a recording into one HTML file, in place of any that is there.

    Raises:
        RecordingError: the recording cannot be read.
        CrossfixError: bokeh is missing, or the file cannot be written.
    """
    require_bokeh()
    _require_page(recording, output)
    from .page import html_page

    story = read_story(recording)
    series = frame_series(story)
    figures = figures_of(story, series)
    try:
        output.write_text(html_page(story, series, figures), encoding="utf-8")
    except OSError as error:
        raise _not_written(output, error) from error
    return figures


def read_figures(recording: Path) -> Figures:
    """The figures alone.

    Raises:
        RecordingError: the recording cannot be read.
    """
    story = read_story(recording)
    return figures_of(story, frame_series(story))


def _require_page(recording: Path, output: Path) -> None:
    """Find out whether the page can be written before a long recording is read for it."""
    if not output.exists():
        require_writable(output)
        return
    if recording.exists() and output.samefile(recording):
        raise CrossfixError("the report would overwrite its recording", where=str(output))
    try:
        output.open("ab").close()
    except OSError as error:
        raise _not_written(output, error) from None


def _not_written(output: Path, error: OSError) -> CrossfixError:
    return CrossfixError(
        "cannot write the report",
        where=str(output),
        got=error.strerror,
        expected="--output elsewhere",
    )


def as_json(figures: Figures) -> str:
    """The figures as one JSON object."""
    return msgspec.json.format(msgspec.json.encode(figures)).decode()


def as_markdown(figures: Figures) -> str:
    """The figures as a page of Markdown."""
    return markdown_page(figures)
