"""`crossfix export`: a recording in the formats of viewers, spreadsheets and globes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

if TYPE_CHECKING:
    from crossfix.analysis import Recording
    from crossfix.making import Made
    from crossfix.reading_progress import Show

FormatName = Literal["foxglove", "csv", "czml", "rerun"]
MODULES = {"foxglove": "foxglove", "czml": "czml", "rerun": "rerun_file"}
ENDINGS = {"foxglove": ".foxglove.mcap", "csv": "-csv", "czml": ".czml", "rerun": ".rrd"}


def export(
    form: FormatName,
    recording: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    topic: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> None:
    """Write a recording for another program; nothing is overwritten.

    `foxglove`: MCAP for Foxglove and Lichtblick, with target logs as ellipses and bearings as
    lines, every carrier's frame as believed and as corrected, places on the map, and a log.
    `csv`: a folder with a table a topic. `czml`: a document for Cesium. `rerun`: a file for the
    Rerun viewer; needs `pip install 'crossfix[rerun]'`. Exit code 0: written; 2: it cannot be.

    ```
    crossfix export foxglove recordings/strait.mcap
    crossfix export csv recordings/strait.mcap --topic correction -o recordings/tables
    ```

    Args:
        form: foxglove, csv, czml or rerun.
        recording: the MCAP file; a torn one is shown as far as it goes.
        output: file or folder to make, by default beside the recording.
        topic: of csv, only this one, such as `correction`; may be repeated.
        as_json: one JSON object instead of a line for each file.
    """
    import msgspec

    from crossfix.analysis import open_recording
    from crossfix.reading_progress import reading
    from schemas.errors import CrossfixError

    if topic and form != "csv":
        raise CrossfixError("--topic", got=form, expected="it with csv only")
    with open_recording(recording) as opened, reading(opened, f"export {form}") as show:
        target = output or recording.with_name(recording.stem + ENDINGS[form])
        files = _write(form, opened, target, topic, show)
    if as_json:
        print(msgspec.json.encode({"format": form, "files": files}).decode())
        return
    for file in files:
        print(f"{file['path']}: " + ", ".join(f"{v} {n}" for n, v in file.items() if n != "path"))


def _write(
    form: FormatName, recording: Recording, target: Path, topics: tuple[str, ...], show: Show
) -> list[dict[str, Any]]:
    """What was written, file by file."""
    from importlib import import_module

    if form == "csv":
        from crossfix.export.tables import export as tabulate

        return [table._asdict() for table in tabulate(recording, target, topics)]
    module = import_module(f"crossfix.export.{MODULES[form]}")
    made: Made = module.export(recording, target, show)
    return [made._asdict()]
