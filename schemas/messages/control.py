"""How a run proceeds: steps, closings, acknowledgements, states, events, queries."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

from .values import Count, Id, Real, Share, Text, TimeNs

Option = bool | int | Real | Text | list[Real | Text] | None
"""A value a user can write into a settings table."""


class StreamEnd(Struct, frozen=True, kw_only=True, order=True):
    """Up to which message a stream counts: everything with seq <= last_seq."""

    carrier: Id
    boot: Id
    stream: Id
    last_seq: Count


class StreamSpan(Struct, frozen=True, kw_only=True, order=True):
    """The messages first .. last of one stream, both included."""

    carrier: Id
    boot: Id
    stream: Id
    first: Count
    last: Count


class Closed(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """An instant is over: exactly what is named here is fused, and nothing else ever decides that.

    Attributes:
        step: counts from 1 in every mode.
        t_ns: the instant that is closed, in scenario time.
        manifest: the last message of every stream with news.
        late: messages of earlier manifests that arrived after they had been given up.
        gave_up: messages the manifest covers that could not be had.
        joined, lost: carriers that take part from here on, or no longer.
        final: nothing follows.
    """

    step: Annotated[int, Meta(ge=1)]
    t_ns: TimeNs
    manifest: list[StreamEnd] = []
    late: list[StreamSpan] = []
    gave_up: list[StreamSpan] = []
    joined: list[Id] = []
    lost: list[Id] = []
    final: bool = False


class Step(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The world grants a step: its truth is out, carriers may observe it.

    Attributes:
        boot: of the world.
        mode: lockstep waits for every answer, paced follows the wall clock.
        final: the last step of the run.
        given_up: boots the world no longer waits for; a process that finds its own here has been
            taken for dead and starts a new boot.
        ended: no step follows, for this reason; processes finish and leave.
    """

    boot: Id
    step: Count
    t_ns: TimeNs
    mode: Literal["lockstep", "paced"] = "lockstep"
    final: bool = False
    given_up: list[Id] = []
    ended: Text = ""


class Ack(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A process has done all of a step; a carrier names the last message of each of its streams.

    Step 0 says that the process is ready for the first one.
    """

    process: Id
    boot: Id
    step: Count
    manifest: list[StreamEnd] = []


class ProcessState(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """State and counters of a process, once a second of wall time (status, outside byte-equality).

    Attributes:
        t_ns: wall clock of the process.
        counters: name -> count since its boot.
    """

    process: Id
    boot: Id
    t_ns: TimeNs
    step: Count = 0
    phase: Id = "running"
    counters: dict[Text, int] = {}


class Event(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What an operator did; an input of the fusion, effective from a named step.

    Attributes:
        id: unique; a repeated command with the same id changes nothing.
        kind: bind or forbid a pair of logs, suspend or resume a carrier's correction, set a
            setting.
        pair: two tracks as carrier/source/track_id.
        setting: dotted name, with `value` the new value.
    """

    centre: Id
    seq: Count
    step: Count
    t_ns: TimeNs
    id: Text
    kind: Literal["bind", "forbid", "suspend", "resume", "set"]
    carrier: Id | None = None
    pair: Annotated[list[Text], Meta(max_length=2)] = []
    setting: Text = ""
    value: Option = None


class Command(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A query to the fusion centre that becomes an event; same fields, same meaning."""

    id: Text
    kind: Literal["bind", "forbid", "suspend", "resume", "set"]
    carrier: Id | None = None
    pair: Annotated[list[Text], Meta(max_length=2)] = []
    setting: Text = ""
    value: Option = None


class PlayerCommand(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A query to a replay: pause, resume, step, seek (to `t_ns`), rate (to `rate`), status, stop.

    Attributes:
        t_ns: log time; messages from there on follow, after the latched values of that instant.
        rate: multiple of the recorded pace; 0 = as fast as it goes.
    """

    id: Text
    kind: Literal["pause", "resume", "step", "seek", "rate", "status", "stop"]
    t_ns: TimeNs | None = None
    rate: Annotated[float, Meta(ge=0, le=1e6)] | None = None


class PlayerStatus(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The reply of a replay: whether the command was taken, and where it stands now.

    Attributes:
        t_ns: log time of the last message published; of the next one after a seek.
        start_ns, end_ns: log time of the first and the last message there is.
        rate: 0 = as fast as it goes.
        sent: messages published since the start.
    """

    id: Text
    taken: bool
    reason: Text = ""
    state: Literal["waiting", "playing", "paused", "ended"] = "playing"
    t_ns: TimeNs = 0
    start_ns: TimeNs = 0
    end_ns: TimeNs = 0
    rate: Annotated[float, Meta(ge=0, le=1e6)] = 1.0
    sent: Count = 0


class Clock(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Where a replay stands, some times a second (status).

    Attributes:
        t_ns: log time of the recording.
        rate: 0 = as fast as it goes.
    """

    player: Id
    t_ns: TimeNs
    rate: Annotated[float, Meta(ge=0, le=1e6)] = 1.0
    state: Literal["waiting", "playing", "paused", "ended"] = "playing"


class RecorderCommand(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A query to a recorder: pause, resume, split, snapshot, status.

    Attributes:
        output: of a snapshot: name of the new file, in the folder of the recording.
        last_s: of a snapshot: how much log time it holds.
    """

    id: Text
    kind: Literal["pause", "resume", "split", "snapshot", "status"]
    output: Text = ""
    last_s: Annotated[float, Meta(gt=0, le=1e9)] | None = None


class Answer(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The reply to a command: whether it was taken, from which step it holds, or why not."""

    id: Text
    taken: bool
    step: Count = 0
    reason: Text = ""


class BackfillRequest(Struct, frozen=True, kw_only=True):
    """Asks a process for messages first .. last of (boot, stream) once more; 500 at most.

    Attributes:
        boot: which life of the process; empty = the one it is in.
        stream: as in the envelope; for what has none, the key after the run.
    """

    boot: Text = ""
    stream: Text
    first: Count
    last: Count


class BackfillRecord(Struct, frozen=True, kw_only=True):
    """One message as it was published: key, encoding and payload."""

    key: Text
    encoding: Text
    payload: bytes


class BackfillReply(Struct, frozen=True, kw_only=True):
    """What a process still holds of the messages asked for, in order."""

    records: list[BackfillRecord]


class StreamStatistics(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Counts of one stream as one receiver has seen it.

    Attributes:
        gaps: messages missed on the way and fetched again; gave_up: never had.
        rejected: payloads refused, with the last reason; unclaimed: never named by a Closed.
    """

    carrier: Id
    stream: Id
    received: Count = 0
    duplicates: Count = 0
    gaps: Count = 0
    gave_up: Count = 0
    late: Count = 0
    rejected: Count = 0
    unclaimed: Count = 0
    reason: Text = ""


class Health(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What the fusion centre sees of the run, once a second and at once on any loss (status).

    Attributes:
        t_ns: wall clock of the centre.
        alive, lost: carriers by their tokens.
        news: sentences about what happened since the last one.
        queue_drops: messages lost between bus and process, by queue.
        recorder: received, recorded, dropped, bytes of the recording.
        load: share of the wall time spent in fusing.
    """

    centre: Id
    t_ns: TimeNs
    step: Count
    alive: list[Id] = []
    lost: list[Id] = []
    news: list[Text] = []
    streams: list[StreamStatistics] = []
    queue_drops: dict[Text, int] = {}
    recorder: dict[Text, int] = {}
    load: Share = 0.0


class KeyStatistics(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What became of the samples of one key since the recorder began.

    received = recorded + rejected + repeated + passed_over + dropped.

    Attributes:
        recorded: messages in the file.
        gaps: messages that were missed on the way and could not be fetched again.
        dropped: lost by the recorder, in its queue or to an error of the disk.
        repeated: of messages it had already; passed_over: while it was paused, or not wanted.
    """

    key: Text
    received: Count = 0
    recorded: Count = 0
    gaps: Count = 0
    dropped: Count = 0
    rejected: Count = 0
    repeated: Count = 0
    passed_over: Count = 0


class Statistics(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The recorder's counts at one moment (channel `crossfix.stats`).

    Attributes:
        keys: those whose counts have changed since the last statistics.
    """

    t_ns: TimeNs
    received: Count
    recorded: Count
    dropped: Count = 0
    gaps: Count = 0
    bytes: Count = 0
    disk_errors: Count = 0
    keys: list[KeyStatistics] = []


class RecorderStatus(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The reply of a recorder: whether the command was taken, and how it stands.

    Attributes:
        files: that hold the recording so far, by their names.
        statistics: so far, of every key.
    """

    id: Text
    taken: bool
    reason: Text = ""
    state: Literal["recording", "paused", "failed"] = "recording"
    files: list[Text] = []
    statistics: Statistics | None = None
