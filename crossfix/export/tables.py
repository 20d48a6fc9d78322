"""A recording as tables: one CSV file a topic, one column a field."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import NamedTuple

from crossfix.analysis import Recording
from schemas import keys
from schemas.errors import CrossfixError


class Table(NamedTuple):
    """One file that was written."""

    path: str
    rows: int
    columns: int


def export(recording: Recording, folder: Path, topics: tuple[str, ...] = ()) -> list[Table]:
    """Write a table of each topic into a new folder; rows and columns are those of `columns`.

    Floats keep every digit, what is absent is empty. Each topic is read twice, first for its
    columns and then for its rows: memory does not grow with the recording.

    Args:
        topics: by name, such as `correction`; none = all that the recording holds.

    Raises:
        CrossfixError: the folder exists or cannot be made, or a topic does not exist.
        RecordingError: the recording is damaged.
    """
    wanted = [topic for topic in keys.TOPICS if topic.recorded]
    if topics:
        known = {topic.name for topic in wanted}
        for name in topics:
            if name not in known:
                raise CrossfixError("no such topic", got=name, expected=", ".join(sorted(known)))
        wanted = [topic for topic in wanted if topic.name in topics]
    try:
        folder.mkdir()
    except OSError as error:
        raise CrossfixError(
            "cannot make the folder", where=str(folder), got=error.strerror,
            expected="--output with the name of a new one",
        ) from None  # fmt: skip
    try:
        tables = [_written(recording, topic, folder / f"{topic.name}.csv") for topic in wanted]
    except OSError as error:
        raise CrossfixError("cannot write", where=str(folder), got=error.strerror) from error
    return [table for table in tables if table.rows]


def _written(recording: Recording, topic: keys.Topic, path: Path) -> Table:
    columns: dict[str, None] = {}
    for row in recording.rows(topic):
        columns.update(dict.fromkeys(row))
    if not columns:
        return Table(str(path), 0, 0)
    rows = 0
    with path.open("x", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(columns), restval="")
        writer.writeheader()
        for row in recording.rows(topic):
            writer.writerow(row)
            rows += 1
    return Table(str(path), rows, len(columns))
