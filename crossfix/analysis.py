"""A recording for analysis: its messages by their types, and as columns of numpy."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Self, TypeVar, overload

from msgspec import Struct

from crossfix.columns import Columns, Row, columns_of, rows_of
from schemas import keys
from schemas.errors import CrossfixError, WireError
from schemas.recording import reader
from schemas.recording.reader import Recorded
from schemas.recording.records import Source

T = TypeVar("T", bound=Struct)
What = type[Struct] | keys.Topic | str
"""A type of message, a row of `schemas.keys.TOPICS`, or its name, such as `report`."""


class Recording(reader.Recording):
    """A recording that is open; use it in a `with`.

    ```
    with crossfix.open_recording("strait.mcap") as recording:
        for correction in recording.read(Correction, carrier="siroco"):
            print(correction.t_ns, correction.state)
        logs = recording.columns("report", carrier="levante")
        print(logs["bearing_rad"].mean())
    ```

    Attributes:
        unreadable: messages passed over so far because their payload is not what its key says.
    """

    unreadable = 0

    def __enter__(self) -> Self:
        return self

    @overload
    def read(self, what: type[T], **ids: str) -> Iterator[T]: ...
    @overload
    def read(self, what: keys.Topic | str, **ids: str) -> Iterator[Struct]: ...
    def read(self, what: What, **ids: str) -> Iterator[Struct]:
        """The messages of a type or topic, decoded, in the order of the file.

        Args:
            what: such as `Correction`, `keys.CLOSED_FUSION` or "closed_fusion".
            ids: of the key, such as carrier="siroco"; what is not named may be anything.

        Raises:
            CrossfixError: no such topic, or it has no such id.
            RecordingError: at the first damage, after all that lies before it.
        """
        return (message for _, message in self._decoded(topics_of(what), ids))

    def columns(self, what: What, **ids: str) -> Columns:
        """The same as columns, `log_time_ns` first.

        A report has a row for each target log, a picture one for each track, an association and
        the truth one for each target, a quality one for each source; everything else has one row a
        message. Covariances are their upper triangles, `own_axes.covariance.0` and so on.

        Raises:
            CrossfixError, RecordingError: as `read`.
        """
        return columns_of(self.rows(what, **ids))

    def rows(self, what: What, **ids: str) -> Iterator[Row]:
        """The rows of `columns`, one by one."""
        for recorded, message in self._decoded(topics_of(what), ids):
            for row in rows_of(message):
                yield {"log_time_ns": recorded.log_time_ns, **row}

    def _decoded(
        self, topics: Collection[keys.Topic], ids: dict[str, str]
    ) -> Iterator[tuple[Recorded, Struct]]:
        for name in ids:
            if not any(f"{{{name}}}" in topic.template for topic in topics):
                names = ", ".join(topic.name for topic in topics)
                raise CrossfixError("no such id in the key", where=names, got=name)
        for recorded in self.messages(topics=topics):
            address = recorded.address
            if all(address.ids.get(name) == wanted for name, wanted in ids.items()):
                try:
                    yield recorded, recorded.decode()
                except WireError:
                    self.unreadable += 1


def open_recording(path: Path | str) -> Recording:
    """Open a recording for analysis; close it, or use it in a `with`.

    A recording whose recorder was killed is read as far as it goes; `condition` says so.

    Raises:
        RecordingError: no file, not MCAP, no recording of ours, a newer format, a damaged header.
    """
    source = Source(Path(path))
    try:
        return Recording(source)
    except BaseException:
        source.close()
        raise


def topics_of(what: What) -> list[keys.Topic]:
    """The topics that are meant.

    Raises:
        CrossfixError: there is none; names those there are.
    """
    if isinstance(what, keys.Topic):
        return [what]
    found = [topic for topic in keys.TOPICS if what in (topic.name, topic.message)]
    if not found:
        name = what if isinstance(what, str) else what.__name__
        known = ", ".join(topic.name for topic in keys.TOPICS if topic.recorded)
        raise CrossfixError("no such topic", got=name, expected=f"one of {known}")
    return found
