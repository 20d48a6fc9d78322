"""The report of a recording: figures for people and programs, and a page that needs no network."""

from __future__ import annotations

from importlib.util import find_spec

from schemas.errors import CrossfixError


def require_bokeh() -> None:
    """Make sure that a page can be drawn, before any work is done for it.

    Raises:
        CrossfixError: bokeh is not installed; says how to get it.
    """
    if find_spec("bokeh") is None:
        raise CrossfixError(
            "the report is drawn with bokeh, which is not installed",
            expected="pip install 'crossfix[view]' (--json and --md do without)",
        )
