"""What carriers say with a correction of theirs, held against the correction that was sent."""

from __future__ import annotations

from collections import Counter, OrderedDict, deque
from math import cos, hypot, remainder, sqrt
from typing import NamedTuple

from .. import keys
from ..feedback import NS, TURN, is_sent, moved
from ..messages import Correction, Feedback, Navigation, Pose, SourceReport
from .findings import Notes

REMEMBERED = 4096
PENDING = 1000
"""A message may be heard before the correction it names; so many wait for theirs."""
LEAST_M, SIGMAS = 1.0, 0.5
"""A place may lie so far from where the correction puts it, or so many of its sigmas."""
LEAST_RAD = 1e-4
LEAST_MESSAGES = 8
LAST_STEP = 10**18
EARTH_M = 6.371e6


class Claim(NamedTuple):
    """A message that names a correction."""

    carrier: str
    source: str
    message: Navigation | SourceReport

    @property
    def example(self) -> str:
        """The beginning of a sentence about it."""
        return f"seq {self.message.seq} names {self.message.correction_id}"


class CorrectionsCheck:
    """Takes corrections and what carriers say with them, in any order."""

    def __init__(self, notes: Notes) -> None:
        self._notes = notes
        self._sent: OrderedDict[str, Correction] = OrderedDict()
        self._pending: deque[Claim] = deque(maxlen=PENDING)
        self._named: set[tuple[str, str]] = set()
        self._applies: dict[str, bool] = {}
        self._plain: Counter[tuple[str, str]] = Counter()

    def sent(self, correction: Correction) -> None:
        """Note a correction of the fusion centre."""
        self._sent[correction.id] = correction
        if len(self._sent) > REMEMBERED:
            self._sent.popitem(last=False)

    def take(self, message: Navigation | SourceReport) -> None:
        """Hold a message against the correction it names."""
        claim = Claim(message.carrier, message.stream, message)
        if isinstance(message, Navigation):
            self._applies[message.carrier] = bool(message.correction_id)
        if hidden := _hidden(message):
            self._notes.add("correction_hidden", *claim[:2], f"seq {message.seq} {hidden}")
        elif message.correction_id:
            self._take_claim(claim)
        elif isinstance(message, SourceReport) and _is_turnable(message):
            self._plain[claim[:2]] += self._applies.get(message.carrier, False)

    def _take_claim(self, claim: Claim) -> None:
        """Judge it at once, or when its correction has come."""
        self._named.add(claim[:2])
        if correction := self._sent.get(claim.message.correction_id):
            _judge(self._notes, claim, correction)
        else:
            self._pending.append(claim)

    def judge(self, notes: Notes) -> None:
        """Say what only all of it together shows."""
        oldest: dict[str, Correction] = {}
        for sent in self._sent.values():
            oldest.setdefault(sent.carrier, sent)
        for claim in self._pending:
            name, first = claim.message.correction_id, oldest.get(claim.carrier)
            if correction := self._sent.get(name):
                _judge(notes, claim, correction)
            elif not is_sent(name, keys.FUSION, claim.carrier, first.step if first else LAST_STEP):
                notes.add("correction_name", *claim[:2], f"{claim.example}, which was never sent")
        for stream, count in self._plain.items():
            if count >= LEAST_MESSAGES and stream not in self._named:
                told = f"{count} reports name none, and the pose of their time does"
                notes.add("correction_half", *stream, told)


def _hidden(message: Navigation | SourceReport) -> str:
    """What a message leaves unsaid of a correction that it holds, in words; empty if nothing."""
    named = bool(message.correction_id)
    if isinstance(message, SourceReport):
        return "has turned_rad and no correction_id" if message.turned_rad and not named else ""
    if named and message.uncorrected is None:
        return f"names {message.correction_id} and has no uncorrected pose"
    return "" if named or message.uncorrected is None else "has uncorrected and no correction_id"


def _is_turnable(report: SourceReport) -> bool:
    """Whether it has directions that a correction would turn."""
    return bool(report.bearing_rad or report.east_m)


def _judge(notes: Notes, claim: Claim, correction: Correction) -> None:
    """Hold one message against its correction."""
    feedback, message = correction.feedback, claim.message
    if feedback is None:
        told = f"{claim.example}, which is {correction.state} and has no feedback"
        notes.add("correction_name", *claim[:2], told)
        return
    if isinstance(message, SourceReport):
        astray_rad = abs(remainder(message.turned_rad - feedback.north_rad, TURN))
        if astray_rad > LEAST_RAD:
            told = f"{message.turned_rad:.4g} rad where it says {feedback.north_rad:.4g}"
            notes.add("correction_turn", *claim[:2], f"{claim.example}: turned_rad is {told}")
    elif message.uncorrected is not None:
        passed_s = (message.t_ns - correction.valid_t_ns) * NS
        expected = moved(message.uncorrected, feedback, passed_s)
        astray_m = _apart_m(message.pose, expected)
        if astray_m > _tolerance_m(feedback, passed_s):
            told = f"the pose is {astray_m:.4g} m from where it puts it"
            notes.add("correction_place", *claim[:2], f"{claim.example}: {told}")


def _tolerance_m(feedback: Feedback, passed_s: float) -> float:
    """What place a correction leaves open: some of its doubt, and whether the drift is applied."""
    drift_mps = hypot(feedback.latitude_rad_s, feedback.longitude_rad_s) * EARTH_M
    doubt_m = sqrt(feedback.covariance[0] + feedback.covariance[3])
    return max(LEAST_M, SIGMAS * doubt_m) + drift_mps * abs(passed_s)


def _apart_m(one: Pose, other: Pose) -> float:
    """Between two places that are near each other."""
    east = remainder(one.longitude_rad - other.longitude_rad, TURN) * cos(other.latitude_rad)
    return EARTH_M * hypot(east, one.latitude_rad - other.latitude_rad)
