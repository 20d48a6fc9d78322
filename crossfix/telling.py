"""Asks a recorder or a replay that is under way, and puts its answer into words."""

from __future__ import annotations

import secrets
import time
from typing import Literal, TypeVar

from msgspec import Struct

from schemas import codec, keys
from schemas.bus.interface import Bus
from schemas.errors import BusError, CrossfixError
from schemas.messages import PlayerCommand, PlayerStatus, RecorderCommand, RecorderStatus

ANSWER_S = 5.0
PAUSE_S = 0.1
NS = 10**9
LEAST_UNIX_NS = 10**15
"""A smaller number is seconds from the start of a recording."""
Command = Literal["pause", "resume", "status", "step", "seek", "rate", "stop", "split", "snapshot"]
T = TypeVar("T", bound=Struct)


def ask(
    bus: Bus, run: str, who: str, command: Command, value: str | None, last_s: float
) -> PlayerStatus | RecorderStatus:
    """The answer of a process to a command; one that is just starting is given some seconds.

    Raises:
        CrossfixError: the command does not go with its value.
        BusError: nobody of that name answered.
    """
    deadline_s = time.monotonic() + ANSWER_S
    while (answer := _asked(bus, run, who, command, value, last_s)) is None:
        if time.monotonic() > deadline_s:
            raise BusError(
                f"no recorder or replay `{who}` in run `{run}` answered",
                expected="--run, --connect",
            )
        time.sleep(PAUSE_S)
    return answer


def _asked(
    bus: Bus, run: str, who: str, command: Command, value: str | None, last_s: float
) -> PlayerStatus | RecorderStatus | None:
    if command == "pause" or command == "resume" or command == "status":  # noqa: PLR1714 - mypy
        return _first(bus, run, who, command)
    if command == "split" or command == "snapshot":  # noqa: PLR1714 - mypy
        return _recorder(bus, run, who, _to_recorder(command, value, last_s))
    return _player(bus, run, who, _to_player(bus, run, who, command, value))


def described(answer: PlayerStatus | RecorderStatus) -> str:
    """An answer in a line or two."""
    refused = f"refused: {answer.reason}\n" if not answer.taken else ""
    if isinstance(answer, PlayerStatus):
        rate = f"rate {answer.rate:g}" if answer.rate else "as fast as it goes"
        into_s = (answer.t_ns - answer.start_ns) / NS
        return f"{refused}{answer.state} at {into_s:.3f} s, {rate}, {answer.sent} messages sent"
    counts = answer.statistics
    lost = f", {counts.dropped} dropped, {counts.gaps} never had" if counts else ""
    told = f", {counts.recorded} messages recorded{lost}" if counts else ""
    return f"{refused}{answer.state}{told}, in {', '.join(answer.files)}"


def _first(
    bus: Bus, run: str, who: str, command: Literal["pause", "resume", "status"]
) -> PlayerStatus | RecorderStatus | None:
    """Of whoever has that name: a replay or a recorder."""
    player = PlayerCommand(id=secrets.token_hex(8), kind=command)
    recorder = RecorderCommand(id=secrets.token_hex(8), kind=command)
    return _player(bus, run, who, player) or _recorder(bus, run, who, recorder)


def _to_player(
    bus: Bus,
    run: str,
    who: str,
    command: Literal["step", "seek", "rate", "stop"],
    value: str | None,
) -> PlayerCommand:
    name = secrets.token_hex(8)
    if command == "rate":
        rate = 0.0 if value == "max" else _number(value, "max or a number above 0")
        return PlayerCommand(id=name, kind="rate", rate=rate)
    if command == "seek":
        t_ns = _instant_ns(bus, run, who, _number(value, "seconds from the start, or Unix ns"))
        return PlayerCommand(id=name, kind="seek", t_ns=t_ns)
    return PlayerCommand(id=name, kind=command)


def _instant_ns(bus: Bus, run: str, who: str, value: float) -> int:
    if value >= LEAST_UNIX_NS:
        return int(value)
    status = _player(bus, run, who, PlayerCommand(id=secrets.token_hex(8), kind="status"))
    return (status.start_ns if status else 0) + round(value * NS)


def _to_recorder(
    command: Literal["split", "snapshot"], value: str | None, last_s: float
) -> RecorderCommand:
    name = secrets.token_hex(8)
    if command == "split":
        return RecorderCommand(id=name, kind="split")
    if value is None:
        raise CrossfixError("snapshot", expected="the name of the new file: snapshot NEW.mcap")
    return RecorderCommand(id=name, kind="snapshot", output=value, last_s=last_s)


def _number(value: str | None, expected: str) -> float:
    try:
        return float(value or "")
    except ValueError:
        raise CrossfixError("no number", got=value, expected=expected) from None


def _player(bus: Bus, run: str, who: str, command: PlayerCommand) -> PlayerStatus | None:
    return _answer(bus, keys.PLAYER.key(run, who), command, PlayerStatus)


def _recorder(bus: Bus, run: str, who: str, command: RecorderCommand) -> RecorderStatus | None:
    return _answer(bus, keys.RECORDING.key(run, who), command, RecorderStatus)


def _answer(bus: Bus, key: str, command: Struct, kind: type[T]) -> T | None:
    payload, encoding = codec.encode(command), codec.encoding_of(type(command))
    samples = bus.query(key, payload, encoding, ANSWER_S)
    return codec.decode(kind, samples[0].payload, samples[0].encoding) if samples else None
