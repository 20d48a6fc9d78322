"""MCAP files of JSON under JSON Schemas, which any viewer reads; not recordings of ours."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

from .builder import McapBuilder
from .plain_file import PlainFile


class JsonFile:
    """One file, for one thread; use it in a `with`.

    Raises:
        RecordingError: the file exists or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.messages = 0
        self._sink = PlainFile(path)
        self._builder = McapBuilder(self._sink, "")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def write(self, topic: str, schema_name: str, schema: bytes, t_ns: int, payload: bytes) -> None:
        """Append a message; the schema of a topic is that of its first one."""
        channel = self._channels.get(topic)
        if channel is None:
            if schema_name not in self._schemas:
                number = self._builder.add_schema(schema_name, "jsonschema", schema)
                self._schemas[schema_name] = number
            channel = self._builder.add_channel(topic, "json", self._schemas[schema_name], {})
            self._channels[topic] = channel
        self._builder.add_message(channel, t_ns, t_ns, self.messages & 0xFFFFFFFF, payload)
        self.messages += 1

    def __enter__(self) -> JsonFile:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            if kind is None:
                self._builder.finish()
        finally:
            self._sink.close()
