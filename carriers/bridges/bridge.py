"""A carrier whose sources are real: envelopes, SourceInfo and navigation around what a feed says.

Every bridge is this one with another decoder. It trusts nothing a decoder hands it: each message is
checked as if it came from the wire, and what does not pass is counted under the field to blame.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, Literal, NamedTuple, Protocol

import msgspec

from schemas import keys
from schemas.errors import WireError
from schemas.messages import Correction, Input, Navigation, Pose, SourceProperties, SourceReport

from ..feedback import Newest
from .counts import Counts
from .records import Reading, RecordError

Coordinates = Literal["bearing_range", "bearing", "cartesian", "geodetic"]
NAVIGATION_NS = 10**9
"""A carrier at rest says where it is this often."""
MAX_SOURCES = 256
_PATH = re.compile(r" - at `\$\.?(?:\[\.\.\.\])?([^`\[.]*)[^`]*`$")
_NAMED = re.compile(r"`([^`]+)`$|^(\w+)(?:\[\d+\])?: ")


class Outlet(Protocol):
    """Where messages go: the outbox of a process, or a printer."""

    @property
    def boot(self) -> str:
        """This life of the sender."""

    def send(self, topic: keys.Topic, ids: tuple[str, ...], message: msgspec.Struct) -> None:
        """Publish one message."""


class Station(NamedTuple):
    """What a bridge says of its carrier and sources where the feed says nothing.

    Attributes:
        pose: where the carrier stands; None = the feed brings its navigation.
        covariance: of (east, north, north direction) of poses that bring none; upper triangle.
        properties: of sources that do not tell theirs; their coordinates are seen from the logs
            unless `coordinates_known`.
        max_clock_error_s: stamps further from the run's time than this are late or refused.
        stamp_arrivals: take the time of arrival for every stamp.
        use_corrections: say everything with the correction that the fusion centre has sent last.
    """

    pose: Pose | None = None
    covariance: list[float] | None = None
    properties: SourceProperties = SourceProperties()
    coordinates_known: bool = False
    max_clock_error_s: float = 1.0
    stamp_arrivals: bool = False
    use_corrections: bool = False


class Bridge:
    """Publishes what a decoder has understood as one carrier; step 0, for it answers no steps."""

    def __init__(
        self, carrier: str, outlet: Outlet, station: Station, now_ns: Callable[[], int]
    ) -> None:
        self.counts = Counts()
        self.carrier = keys.require_id(carrier)
        self._outlet, self._station, self._now_ns = outlet, station, now_ns
        self._tolerance_ns = round(station.max_clock_error_s * 1e9)
        self._last_seq: dict[str, int] = {}
        self._sources: set[str] = set()
        self._told: set[str] = set()
        self._navigated_ns = -NAVIGATION_NS
        self._newest = Newest()

    @property
    def uses_corrections(self) -> bool:
        """Whether it wants to hear them."""
        return self._station.use_corrections

    def hear(self, correction: Correction) -> None:
        """Apply a correction from now on, unless there is a newer one."""
        self._newest.note(correction)

    def take(self, found: Reading | RecordError) -> RecordError | None:
        """Publish a reading, or count a bad record; what is wrong with it, if anything."""
        try:
            if isinstance(found, RecordError):
                raise found
            self._publish(found)
        except RecordError as error:
            self.counts.reject(error.field)
            return error
        self.counts.decoded += 1
        return None

    def stand(self) -> None:
        """Say where the carrier is, if it is at rest and has not said so for a second."""
        self._stand(self._now_ns())

    def _publish(self, reading: Reading) -> None:
        self._require_source(reading)
        now_ns = self._now_ns()
        t_ns = now_ns if reading.t_ns is None or self._station.stamp_arrivals else reading.t_ns
        if t_ns > now_ns + self._tolerance_ns:
            raise RecordError(
                "t_ns",
                f"{(t_ns - now_ns) * 1e-9:.3g} s after the time of the run",
                got=t_ns,
                expected=f"at most {self._station.max_clock_error_s:g} s; stamps of another clock "
                "can be left aside (--stamp arrival)",
            )
        message = self._message(reading, t_ns)
        if reading.topic is keys.REPORT:
            self._stand(t_ns)
            self._tell(reading, t_ns)
            self.counts.late += t_ns < now_ns - self._tolerance_ns
        elif reading.topic is keys.SOURCE:
            self._told.add(reading.source)
        self._send(reading.topic, reading.source, self._corrected(message))

    def _require_source(self, reading: Reading) -> None:
        """Refuse a source whose reports could not be told from other streams."""
        if reading.topic not in (keys.SOURCE, keys.REPORT) or reading.source in self._sources:
            return
        try:
            keys.require_id(reading.source)
        except WireError as error:
            raise RecordError(
                "source", error.what, got=error.got, expected=error.expected
            ) from None
        if reading.source in keys.RESERVED_STREAMS:
            raise RecordError("source", "a reserved name", got=reading.source)
        if len(self._sources) >= MAX_SOURCES:
            raise RecordError("source", f"more than {MAX_SOURCES} sources", got=reading.source)
        self._sources.add(reading.source)

    def _message(self, reading: Reading, t_ns: int) -> Input:
        """The message of a reading with its envelope, checked.

        Raises:
            RecordError: a field is missing or holds what it may not.
        """
        stream = _stream(reading)
        fields = {
            **self._completed(reading),
            "carrier": self.carrier,
            "boot": self._outlet.boot,
            "stream": stream,
            "seq": self._last_seq.get(stream, 0) + 1,
            "t_ns": t_ns,
        }
        try:
            message = msgspec.convert(fields, reading.topic.message)
        except msgspec.ValidationError as error:
            raise bad_field(str(error), fields) from None
        assert isinstance(message, Input)  # noqa: S101 (what carriers say)
        return message

    def _corrected(self, message: Input) -> Input:
        """A message in the corrected frame, if there is one.

        Raises:
            RecordError: its sender has applied a correction already, or it cannot be turned.
        """
        named = isinstance(message, Navigation | SourceReport) and message.correction_id
        if named and self.uses_corrections:
            raise RecordError(
                "correction_id",
                "the bridge applies the corrections",
                got=named,
                expected="records without it, or no --use-corrections",
            )
        try:
            return self._newest.corrected(message)
        except ValueError as error:
            raise RecordError("covariance", str(error)) from None

    def _completed(self, reading: Reading) -> dict[str, Any]:
        """The fields of a reading, with the station's covariance where a pose lacks its own."""
        pose = reading.fields.get("pose")
        if self._station.covariance is None or not isinstance(pose, dict) or "covariance" in pose:
            return reading.fields
        return {**reading.fields, "pose": {**pose, "covariance": self._station.covariance}}

    def _stand(self, t_ns: int) -> None:
        if self._station.pose is None or t_ns < self._navigated_ns + NAVIGATION_NS:
            return
        self._navigated_ns = t_ns
        pose = msgspec.to_builtins(self._station.pose)
        reading = Reading(keys.NAVIGATION, {"pose": pose, "kind": "fix"})
        self._send(reading.topic, "", self._corrected(self._message(reading, t_ns)))

    def _tell(self, report: Reading, t_ns: int) -> None:
        """Say what a source is before its first report that shows it."""
        if report.source in self._told:
            return
        coordinates = self._station.properties.coordinates
        if not self._station.coordinates_known:
            seen = coordinates_of(report.fields)
            if seen is None:
                return
            coordinates = seen
        self._told.add(report.source)
        properties = msgspec.structs.replace(self._station.properties, coordinates=coordinates)
        fields = {"source": report.source, "properties": msgspec.to_builtins(properties)}
        info = Reading(keys.SOURCE, fields, report.source)
        self._send(info.topic, info.source, self._message(info, t_ns))

    def _send(self, topic: keys.Topic, source: str, message: Input) -> None:
        self._outlet.send(topic, (self.carrier, source) if source else (self.carrier,), message)
        self._last_seq[message.stream] = message.seq
        self.counts.published += 1


def bad_field(error: str, fields: dict[str, Any]) -> RecordError:
    """What msgspec has to say of a message, with the field to blame."""
    path = _PATH.search(error)
    words = error[: path.start()] if path else error
    named = _NAMED.search(words)
    field = (path and path[1]) or (named and (named[1] or named[2])) or "record"
    return RecordError(field, words.removeprefix(f"{field}: "), got=_shown(fields.get(field)))


def coordinates_of(fields: dict[str, Any]) -> Coordinates | None:
    """Which coordinates the logs of a report have; None where it has no log."""
    if fields.get("bearing_rad"):
        return "bearing_range" if fields.get("range_m") else "bearing"
    if fields.get("east_m"):
        return "cartesian"
    return "geodetic" if fields.get("latitude_rad") else None


def _stream(reading: Reading) -> str:
    if reading.topic is keys.REPORT:
        return reading.source
    return "info" if reading.topic is keys.SOURCE else reading.topic.name


def _shown(value: object) -> str | None:
    return None if value is None else repr(value)[:80]
