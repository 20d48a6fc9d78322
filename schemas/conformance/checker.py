"""Everything that is wrong with what carriers publish, found by listening."""

from __future__ import annotations

from collections.abc import Iterable

from .. import codec, keys
from ..bus.interface import Sample
from ..bus.ledger import StreamKey
from ..errors import WireError
from ..messages import (
    Ack,
    Correction,
    DeclaredScenario,
    Input,
    Navigation,
    SourceInfo,
    SourceProperties,
    SourceReport,
    Step,
)
from ..received import receive
from . import raw as reading
from . import refusals
from .corrections import CorrectionsCheck
from .findings import Finding, Notes
from .logs import LogsCheck
from .residuals import Residuals, SigmaCheck
from .speakers import Life, Speakers
from .streams import NS, StreamCheck

MAX_STREAMS = 1000
LOOKED_AT_RAW = 20
"""Messages of each stream that are searched for fields nobody reads."""
MAX_SPEED_MPS = 1000.0
"""What has moved faster is another target under the same name."""
LEAST_REPORTS = 3
SLACK_S = 0.5
"""Of wall clocks and of the way of a message."""
LATE_S = 10.0
"""So far behind the world no busy machine is, only another clock, and nothing is fused."""
BEHIND_STEPS = 9
"""In lock-step the world is so many steps ahead of its carriers, and no more."""
UNITS = {"seconds": 1e-9, "milliseconds": 1e-6, "microseconds": 1e-3}


class Conformance:
    """Takes samples in the order of their arrival and says what is wrong with their publishers.

        conformance = Conformance("strait", "visitor")
        for sample in samples:
            conformance.take(sample, arrived_s)
        for finding in conformance.findings():
            print(finding.code, finding.example, finding.advice)

    Args:
        run: only this run's keys are looked at.
        carrier: only this carrier; all where it is None.
        whole: whether the samples begin with the first of every boot; else only of boots that
            `began` while we listened.
    """

    def __init__(self, run: str, carrier: str | None = None, *, whole: bool = True) -> None:
        self._run, self._only, self._whole = keys.require_id(run), carrier, whole
        self._notes = Notes()
        self._streams: dict[StreamKey, StreamCheck] = {}
        self._logs: dict[tuple[str, str], LogsCheck] = {}
        self._residuals: dict[tuple[str, str], Residuals] = {}
        self._infos: dict[tuple[str, str], SourceProperties] = {}
        self._sent: set[tuple[str, str]] = set()
        self._covered: set[str] = set()
        self._scenario: DeclaredScenario | None = None
        self._step_ns: int | None = None
        self._acked: set[str] = set()
        self._stepped: dict[str, str] = {}
        self._speakers = Speakers()
        self._corrections = CorrectionsCheck(self._notes)
        self._navigated: set[str] = set()

    def take(self, sample: Sample, arrived_s: float, *, fetched: bool = False) -> None:
        """Note one sample.

        Args:
            arrived_s: Unix time of its arrival; where no Step of a world is heard, stamps are
                held against it.
            fetched: it was asked for (latched value, backfill), so it may have come before.
        """
        if not sample.key.startswith(f"{keys.PREFIX}/{self._run}/"):
            return
        try:
            address = keys.parse(sample.key)
        except WireError as error:
            self._note_key(sample.key, str(error))
            return
        carrier = address.ids.get("carrier")
        if address.topic.role is keys.Role.INPUT and carrier:
            if self._only in (None, carrier):
                self._take_input(address, sample, arrived_s, fetched)
        elif address.topic in (keys.STEP, keys.SCENARIO, keys.ACK, keys.CORRECTION):
            self._take_control(address, sample)

    def began(self, carrier: str, boot: str) -> None:
        """A boot's token came while we listened: its streams have to begin with seq 1."""
        self._speakers.began(Life(carrier, boot))

    def saw_tokens(self, lives: Iterable[tuple[str, str]]) -> None:
        """Whose liveliness tokens are there; call it again for more."""
        self._speakers.saw_tokens(lives)

    def note(self, code: str, carrier: str, source: str, example: str) -> None:
        """Add what was found by other means, such as a question nobody answered."""
        self._notes.add(code, carrier, source, example)

    def heard(self) -> dict[tuple[str, str], int]:
        """Messages by carrier and source."""
        counts: dict[tuple[str, str], int] = {}
        for key, stream in self._streams.items():
            name = (key.process, stream.source)
            counts[name] = counts.get(name, 0) + stream.count
        return counts

    def lives(self) -> list[Life]:
        """Carriers heard, with their boots."""
        return sorted({Life(key.process, key.boot) for key in self._streams})

    def gaps(self) -> list[tuple[StreamKey, int, int]]:
        """Runs of messages that have not come, for whoever can ask for them."""
        return [
            (key, first, last)
            for key, stream in self._streams.items()
            for first, last in stream.missing()
        ]

    def sigma_checks(self) -> dict[tuple[str, str], list[SigmaCheck]]:
        """Scatter against claim, by carrier and source: also where it is as it should be."""
        return {
            name: residuals.checks(self._declared(name) or SourceProperties())
            for name, residuals in sorted(self._residuals.items())
        }

    def findings(self) -> list[Finding]:
        """Everything wrong so far, errors first."""
        notes = self._notes.copy()
        for key, stream in self._streams.items():
            properties = self._declared((key.process, key.stream))
            stream.judge(notes, properties.period_s if properties else None)
            self._judge_start(notes, stream)
        for name, logs in self._logs.items():
            logs.judge(notes, self._declared(name), unheard=self._is_unheard(name))
            self._judge_tracks(notes, name)
        self._judge_carriers(notes)
        self._corrections.judge(notes)
        return notes.findings()

    # taking

    def _take_control(self, address: keys.Address, sample: Sample) -> None:
        try:
            message = receive(sample).message
        except WireError:
            return
        if isinstance(message, Step):
            self._step_ns = max(self._step_ns or 0, message.t_ns)
        elif isinstance(message, DeclaredScenario):
            self._scenario = message
        elif isinstance(message, Ack):
            self._acked.add(message.process)
        elif isinstance(message, Correction):
            self._corrections.sent(message)

    def _take_input(
        self, address: keys.Address, sample: Sample, arrived_s: float, fetched: bool
    ) -> None:
        carrier, source = address.ids["carrier"], address.ids.get("source", address.topic.name)
        self._sent.add((carrier, _about(address)))
        self._note_encoding(carrier, source, address, sample)
        try:
            message = receive(sample).message
        except WireError as error:
            self._refused(address, sample, error, arrived_s, fetched)
            return
        if not isinstance(message, Input):
            return
        stream = self._stream(address, message.boot)
        if stream is None:
            return
        if not fetched:
            self._speakers.heard(Life(carrier, message.boot))
        if not stream.take(message.seq, message.t_ns, sample.payload, arrived_s, fetched):
            return
        self._note_stamp(stream, message.t_ns, arrived_s, fetched)
        if stream.count <= LOOKED_AT_RAW:
            self._note_unknown(carrier, source, sample, message)
        if message.step:
            self._stepped.setdefault(carrier, f"{source} seq {message.seq} has step {message.step}")
        self._take_message(carrier, message)

    def _take_message(self, carrier: str, message: Input) -> None:
        if isinstance(message, Navigation | SourceReport):
            self._corrections.take(message)
        if isinstance(message, SourceInfo):
            self._infos[carrier, message.source] = message.properties
        elif isinstance(message, Navigation):
            self._navigated.add(carrier)
            if message.pose.covariance is not None:
                self._covered.add(carrier)
        elif isinstance(message, SourceReport):
            name = (carrier, message.stream)
            if name not in self._logs:
                self._logs[name] = LogsCheck(*name, self._notes)
                self._residuals[name] = Residuals()
            self._logs[name].take(message)
            self._residuals[name].take(message)
            stream = self._streams[StreamKey(carrier, message.boot, message.stream)]
            stream.empty += not len(message)

    def _refused(
        self,
        address: keys.Address,
        sample: Sample,
        error: WireError,
        arrived_s: float,
        fetched: bool,
    ) -> None:
        """Say why; of its place in the stream as much as can be believed still counts."""
        carrier, source = address.ids["carrier"], address.ids.get("source", address.topic.name)
        found = refusals.of_sample(error, sample.payload, sample.encoding)
        self._notes.add(found.code, carrier, source, found.example, detail=found.detail)
        if found.code == "name":
            return  # its stream is somebody else's
        head = reading.head(reading.unpacked(sample.payload, sample.encoding) or {})
        if head and head.seq and (stream := self._stream(address, head.boot)):
            stream.take(head.seq, head.t_ns, sample.payload, arrived_s, fetched)

    def _stream(self, address: keys.Address, boot: str) -> StreamCheck | None:
        carrier, stream = address.ids["carrier"], keys.stream(address)
        key = StreamKey(carrier, boot, stream)
        if key not in self._streams:
            if len(self._streams) >= MAX_STREAMS:
                return None
            source = stream if address.topic is not keys.SOURCE else "info"
            self._streams[key] = StreamCheck(key, source, self._notes)
        return self._streams[key]

    # what one message shows

    def _note_key(self, key: str, reason: str) -> None:
        chunks = key.split("/")
        carrier = chunks[4][:32] if len(chunks) > 4 else "unknown"
        source = chunks[5][:32] if len(chunks) > 5 else ""
        if len(chunks) > 3 and chunks[3] in _INPUTS and self._only in (None, carrier):
            self._notes.add("key", carrier, source, reason)

    def _note_encoding(
        self, carrier: str, source: str, address: keys.Address, sample: Sample
    ) -> None:
        forms = ("msgpack", "json")
        right = [codec.encoding_of(address.topic.message, form) for form in forms]
        if sample.encoding not in right:
            example = f"{sample.encoding or 'none'} where {right[0]} is meant"
            self._notes.add("encoding", carrier, source, example)

    def _note_unknown(self, carrier: str, source: str, sample: Sample, message: Input) -> None:
        raw = reading.unpacked(sample.payload, sample.encoding) or {}
        for name in reading.unknown_fields(raw, message):
            self._notes.add("unknown_field", carrier, source, name, detail=name)

    def _note_stamp(self, stream: StreamCheck, t_ns: int, arrived_s: float, fetched: bool) -> None:
        """Hold a stamp against the time of the run, or of the listener where there is no world."""
        if fetched or stream.key.stream == "info":
            return
        now_ns = self._step_ns if self._step_ns is not None else round(arrived_s / NS)
        carrier, source = stream.key.process, stream.source
        for unit, scale in UNITS.items():
            if now_ns and 0.5 < t_ns / (now_ns * scale) < 2:
                example = f"t_ns is {t_ns}, which looks like {unit}"
                self._notes.add("time_unit", carrier, source, example)
                return
        scenario = self._scenario
        allowed_s = scenario.max_clock_error_s if scenario else 1.0
        step_s = scenario.step_ns * NS if scenario else 0.0
        ahead_s = (t_ns - now_ns) * NS
        if ahead_s > allowed_s + step_s + SLACK_S:
            example = f"seq {stream.first + stream.count - 1} is stamped {ahead_s:.4g} s ahead"
            self._notes.add("time_future", carrier, source, example)
        elif self._step_ns is not None and -ahead_s > allowed_s + BEHIND_STEPS * step_s + LATE_S:
            example = f"seq {stream.first + stream.count - 1} is stamped {-ahead_s:.4g} s behind"
            self._notes.add("time_past", carrier, source, example)

    # what all of them show

    def _declared(self, name: tuple[str, str]) -> SourceProperties | None:
        if name in self._infos:
            return self._infos[name]
        declared = self._scenario.carriers if self._scenario else []
        return next((c.sources.get(name[1]) for c in declared if c.name == name[0]), None)

    def _judge_start(self, notes: Notes, stream: StreamCheck) -> None:
        if self._is_from_the_start(stream) and stream.first > 1:
            example = f"begins with seq {stream.first}"
            notes.add("seq_start", stream.key.process, stream.source, example)

    def _is_from_the_start(self, stream: StreamCheck) -> bool:
        life = Life(stream.key.process, stream.key.boot)
        return self._whole or self._speakers.is_new(life)

    def _is_unheard(self, name: tuple[str, str]) -> bool:
        """Whether what a source declares of itself may have been said before we listened."""
        carrier, source = name
        streams = [s for key, s in self._streams.items() if (key.process, key.stream) == name]
        late = all(s.first > 1 and not self._is_from_the_start(s) for s in streams)
        told = (carrier, f"info/{source}") in self._sent or self._declared(name) is not None
        return late and not told

    def _judge_tracks(self, notes: Notes, name: tuple[str, str]) -> None:
        declared = self._declared(name) or SourceProperties()
        residuals = self._residuals[name]
        if notes.has("time_unit", *name):
            return
        for leap in residuals.leaps(declared, MAX_SPEED_MPS):
            notes.add("track_reused", *name, leap)
        suspect = ("sigma_absurd", "kilometres", "sigma_missing")
        if any(notes.has(code, *name) for code in suspect):
            return  # said already, and more plainly
        for check in residuals.checks(declared):
            code = {"too small": "sigma_too_small", "too large": "sigma_too_large"}
            if check.verdict in code:
                example = (
                    f"{check.column}: residuals are {check.ratio:.3g} times the claim "
                    f"({check.low:.3g} to {check.high:.3g} with 99.99 %, {check.number} of them)"
                )
                notes.add(code[check.verdict], *name, example, detail=check.column)

    def _judge_carriers(self, notes: Notes) -> None:
        counts = self.heard()
        for carrier, source in self._logs:
            told = (carrier, source) in self._infos or (carrier, f"info/{source}") in self._sent
            if not told:
                code = "source_unheard" if self._is_unheard((carrier, source)) else "source_info"
                notes.add(code, carrier, source, f"{counts[carrier, source]} reports")
        for carrier in sorted({carrier for carrier, source in self._logs}):
            self._judge_navigation(notes, carrier)
        self._judge_lives(notes)

    def _judge_lives(self, notes: Notes) -> None:
        for carrier, example in self._stepped.items():
            if self._acked and carrier not in self._acked:
                notes.add("unanswered", carrier, "", example)
        self._speakers.judge(notes, self.lives())

    def _judge_navigation(self, notes: Notes, carrier: str) -> None:
        reports = max(s.count for k, s in self._streams.items() if k.process == carrier)
        if (carrier, "navigation") not in self._sent:
            if reports >= LEAST_REPORTS:
                notes.add("navigation", carrier, "navigation", f"{reports} reports and none of it")
            return
        known = {c.name for c in self._scenario.carriers} if self._scenario else {carrier}
        if carrier in self._navigated - self._covered - known:
            notes.add(
                "prior", carrier, "navigation", "a carrier of its own without pose.covariance"
            )


def _about(address: keys.Address) -> str:
    """What a message is about: navigation, ranging, a source's reports, or its info."""
    if address.topic is keys.SOURCE:
        return f"info/{address.ids['source']}"
    return address.ids.get("source", address.topic.name)


_INPUTS = ("source", "report", "navigation", "ranging")
