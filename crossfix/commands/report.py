"""`crossfix report`: a recording as a page to look at, or its figures as JSON or Markdown."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def report(
    recording: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
    as_md: Annotated[bool, Parameter(name="--md", negative="")] = False,
) -> None:
    """Draw a recording: who reported what, what was corrected, what was true, what was lost.

    Writes one HTML file that needs no network: the tactical picture, every correction with its
    sigma and its error, NEES, losses, timing, scenario. Recordings without truth, and those of
    killed runs, are shown as far as they go. The page needs bokeh: `pip install 'crossfix[view]'`.

    ```
    crossfix report recordings/strait.mcap -o report.html
    ```

    Args:
        recording: the MCAP file.
        output: page to write, also over an old one; by default beside the recording.
        as_json: print the figures as one JSON object; no page, unless `-o` asks for it.
        as_md: print the figures as Markdown; no page, unless `-o` asks for it.
    """
    from crossfix.report import writing

    if output is None and (as_json or as_md):
        figures = writing.read_figures(recording)
    else:
        page = output or recording.parent / f"{recording.stem}.html"
        figures = writing.write_page(recording, page)
        if not (as_json or as_md):
            print(f"report: {page}")
    if as_json:
        print(writing.as_json(figures))
    if as_md:
        print(writing.as_markdown(figures), end="")
