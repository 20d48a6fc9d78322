"""Every key of the wire, built and parsed here only; `TOPICS` is the one table of the system."""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import StrEnum
from functools import cache, lru_cache
from typing import NamedTuple

from msgspec import Struct

from . import messages as m
from .errors import WireError
from .qos import CONTROL, DATA, STATUS, Qos

PREFIX = "crossfix/@v1"
WORLD, FUSION, RECORDER = "world", "fusion", "recorder"
RESERVED_PROCESSES = (WORLD, FUSION, RECORDER)
RESERVED_STREAMS = ("info", "navigation", "ranging")
MAX_KEY_BYTES = 256
_ID = re.compile(r"[a-z0-9_-]{1,32}")


class Role(StrEnum):
    """What a topic is to a recording: only inputs are fused, only outputs are compared."""

    INPUT = "input"
    TRUTH = "truth"
    OUTPUT = "output"
    STATUS = "status"
    CONTROL = "control"


class Topic(NamedTuple):
    """One row of the table.

    Attributes:
        template: the key after the run, with the ids it holds in braces.
        rate: how often it is published, in words.
        latched: the last value matters to a late joiner, and its owner answers for it.
        recorded: whether the recorder keeps it.
    """

    name: str
    template: str
    message: type[Struct]
    role: Role
    rate: str
    qos: Qos = DATA
    latched: bool = False
    recorded: bool = True

    def key(self, run: str, *ids: str) -> str:
        """The key of this topic in a run, its ids in the order of the template.

        Raises:
            WireError: an id is missing, too many, or holds what no id may hold.
        """
        names = re.findall(r"{(\w+)}", self.template)
        if len(names) != len(ids):
            raise WireError(f"key of {self.name}", got=ids, expected=f"ids for {names}")
        path = self.template.format(**{n: require_id(i) for n, i in zip(names, ids, strict=True)})
        return f"{PREFIX}/{require_id(run)}/{path}"

    def every(self, run: str) -> str:
        """Key expression of all keys of this topic in a run."""
        path = re.sub(r"{\w+}", "*", self.template)
        return f"{PREFIX}/{require_id(run)}/{path}"


class Address(NamedTuple):
    """A key, understood."""

    run: str
    topic: Topic
    ids: Mapping[str, str]


SCENARIO = Topic(
    "scenario", "scenario", m.DeclaredScenario, Role.CONTROL, "once", CONTROL, latched=True
)
SOURCE = Topic(
    "source", "source/{carrier}/{source}", m.SourceInfo, Role.INPUT, "at start", latched=True
)
REPORT = Topic("report", "report/{carrier}/{source}", m.SourceReport, Role.INPUT, "every period")
NAVIGATION = Topic("navigation", "navigation/{carrier}", m.Navigation, Role.INPUT, "every step")
RANGING = Topic("ranging", "ranging/{carrier}", m.Ranging, Role.INPUT, "every range")
EVENT = Topic("event", "event/{centre}", m.Event, Role.INPUT, "when an operator acts", CONTROL)
CLOSED_WORLD = Topic(
    "closed_world", "closed/world", m.Closed, Role.CONTROL, "every step (lock-step)", CONTROL
)
CLOSED_FUSION = Topic("closed_fusion", "closed/fusion", m.Closed, Role.INPUT, "every step", CONTROL)
STEP = Topic("step", "step", m.Step, Role.CONTROL, "every step", CONTROL, latched=True)
ACK = Topic("ack", "ack/{process}", m.Ack, Role.CONTROL, "every step", CONTROL, recorded=False)
STATE = Topic("state", "state/{process}", m.ProcessState, Role.STATUS, "1 Hz", STATUS)
TRUTH_SCENARIO = Topic(
    "truth_scenario", "truth/scenario", m.TruthScenario, Role.TRUTH, "once", latched=True
)
TRUTH_TARGETS = Topic("truth_targets", "truth/targets", m.TruthTargets, Role.TRUTH, "every step")
TRUTH_CARRIERS = Topic(
    "truth_carriers", "truth/carriers", m.TruthCarriers, Role.TRUTH, "every step"
)
CORRECTION = Topic(
    "correction", "correction/{centre}/{carrier}", m.Correction, Role.OUTPUT, "every Closed",
    latched=True,
)  # fmt: skip
TRACK = Topic("track", "track/{centre}", m.Tracks, Role.OUTPUT, "every Closed", latched=True)
ASSOCIATION = Topic(
    "association", "association/{centre}", m.Association, Role.OUTPUT, "every Closed", latched=True
)
ALIGNMENT = Topic(
    "alignment", "alignment/{centre}", m.Alignment, Role.OUTPUT, "every Closed", latched=True
)
QUALITY = Topic("quality", "quality/{centre}", m.Quality, Role.OUTPUT, "every Closed", latched=True)
HEALTH = Topic(
    "health", "health/{centre}", m.Health, Role.STATUS, "1 Hz and at any loss", STATUS, latched=True
)
COMMAND = Topic(
    "command", "command/{centre}", m.Command, Role.CONTROL, "query", CONTROL, recorded=False
)
PLAYER = Topic(
    "player", "player/{player}", m.PlayerCommand, Role.CONTROL, "query", CONTROL, recorded=False
)
CLOCK = Topic(
    "clock", "clock/{player}", m.Clock, Role.STATUS, "when a replay is asked to", STATUS,
    recorded=False,
)  # fmt: skip
RECORDING = Topic(
    "recorder", "recorder/{recorder}", m.RecorderCommand, Role.CONTROL, "query", CONTROL,
    recorded=False,
)  # fmt: skip
BACKFILL = Topic(
    "backfill", "backfill/{process}", m.BackfillRequest, Role.CONTROL, "query", recorded=False
)

TOPICS: tuple[Topic, ...] = (
    SCENARIO, SOURCE, REPORT, NAVIGATION, RANGING, EVENT, CLOSED_WORLD, CLOSED_FUSION, STEP, ACK,
    STATE, TRUTH_SCENARIO, TRUTH_TARGETS, TRUTH_CARRIERS, CORRECTION, TRACK, ASSOCIATION,
    ALIGNMENT, QUALITY, HEALTH, COMMAND, PLAYER, CLOCK, RECORDING, BACKFILL,
)  # fmt: skip
"""The whole wire."""

COVARIANCES: Mapping[str, tuple[str, ...]] = {
    "covariance_polar": ("bearing_rad", "range_m", "elevation_rad"),
    "covariance_position": ("east_m", "north_m", "up_m"),
    "covariance_velocity": ("velocity_east_mps", "velocity_north_mps", "velocity_up_mps"),
    "pose.covariance": ("east_m", "north_m", "north_rad"),
    "own_axes.covariance": ("east_m", "north_m", "rotation_rad"),
    "fixed_axes.covariance": ("offset_east_m", "offset_north_m", "c1_rad", "c2_rad"),
}
"""Order of the rows of every covariance on the wire (upper triangle, row by row)."""


def require_id(text: str) -> str:
    """Return `text` if it may name a run, carrier, source, process or boot.

    Raises:
        WireError: it may not.
    """
    if not _ID.fullmatch(text):
        raise WireError("not an id", got=text[:64], expected="[a-z0-9_-], 1 to 32 of them")
    return text


@lru_cache(maxsize=4096)  # a run has some dozens; others' may be anything
def parse(key: str) -> Address:
    """Understand a key from the wire, trusting nothing in it.

    Raises:
        WireError: too long, another version, a wildcard, an unknown topic or a bad id.
    """
    if len(key) > MAX_KEY_BYTES:
        raise WireError("key too long", got=len(key), expected=f"<= {MAX_KEY_BYTES} bytes")
    match = _pattern().fullmatch(key)
    if match is None or match.lastgroup is None:
        raise WireError("no key of this protocol", got=key[:128], expected=f"{PREFIX}/run/topic...")
    topic = TOPICS[int(match.lastgroup.removeprefix("topic"))]
    names = re.findall(r"{(\w+)}", topic.template)
    return Address(key.split("/", 3)[2], topic, dict(zip(names, _ids(key, topic), strict=True)))


def everything(run: str) -> str:
    """Key expression of all topics of a run."""
    return f"{PREFIX}/{require_id(run)}/**"


def stream(address: Address) -> str:
    """The stream whose seq a message at this address counts in.

    Inputs of a carrier count per source, and in the reserved streams; everything else counts per
    key, and its stream is the key after the run.
    """
    if address.topic is SOURCE:
        return "info"
    if address.topic in (NAVIGATION, RANGING):
        return address.topic.name
    if address.topic is REPORT:
        return address.ids["source"]
    return address.topic.template.format(**address.ids)


def of_stream(run: str, process: str, stream: str) -> str | None:
    """The key on which the messages of a stream travel; None of `info`, which has one a source.

    Raises:
        WireError: process or stream is no id.
    """
    if "/" in stream:
        return f"{PREFIX}/{require_id(run)}/{stream}"
    if stream in RESERVED_STREAMS:
        topic = next((one for one in (NAVIGATION, RANGING) if one.name == stream), None)
        return topic.key(run, process) if topic else None
    return REPORT.key(run, process, stream)


def alive(run: str, process: str, boot: str) -> str:
    """Key of a process's liveliness token."""
    return f"{PREFIX}/{require_id(run)}/alive/{require_id(process)}/{require_id(boot)}"


def alive_of(run: str, process: str) -> str:
    """Key expression of the liveliness tokens of one process, whatever its boot."""
    return f"{PREFIX}/{require_id(run)}/alive/{require_id(process)}/*"


def every_alive(run: str) -> str:
    """Key expression of the liveliness tokens of a run (`*` for run: of every run)."""
    return f"{PREFIX}/{run if run == '*' else require_id(run)}/alive/*/*"


def parse_alive(key: str) -> tuple[str, str, str]:
    """Run, process and boot of a liveliness token.

    Raises:
        WireError: not such a key.
    """
    match = re.fullmatch(rf"{PREFIX}/({_ID.pattern})/alive/({_ID.pattern})/({_ID.pattern})", key)
    if match is None:
        raise WireError("no liveliness token of this protocol", got=key[:128])
    return match[1], match[2], match[3]


@cache
def _pattern() -> re.Pattern[str]:
    paths = (re.sub(r"{\w+}", _ID.pattern, t.template) for t in TOPICS)
    choices = "|".join(f"(?P<topic{n}>{path})" for n, path in enumerate(paths))
    return re.compile(rf"{PREFIX}/{_ID.pattern}/(?:{choices})")


def _ids(key: str, topic: Topic) -> list[str]:
    chunks = key.split("/")[3:]
    return [c for c, t in zip(chunks, topic.template.split("/"), strict=True) if t.startswith("{")]
