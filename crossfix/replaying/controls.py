"""How a replay is told what to do: by queries under `player/*`, and by keys in its terminal."""

from __future__ import annotations

import select
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Protocol, TextIO

from schemas import codec, keys
from schemas.bus.answering import reply_to
from schemas.bus.interface import Bus, Sample
from schemas.messages import PlayerCommand

from .pace import MAX
from .player import Player

SKIP_NS = 10 * 10**9
LOOK_S = 0.1
HELP = "space pause, s step, left/right 10 s back and on, up/down faster and slower, q quit"


def serve(player: Player, bus: Bus, run: str, name: str) -> None:
    """Answer queries for `player/{name}`."""

    def answer(question: Sample) -> Iterable[Sample]:
        """Reply to one query."""
        command = codec.decode(PlayerCommand, question.payload, question.encoding)
        yield reply_to(question, player.command(command))

    bus.serve(keys.PLAYER.key(run, name), answer)


class Keyboard:
    """Turns keys into commands."""

    def __init__(self, player: Player) -> None:
        self._player = player
        self._pressed = 0

    def press(self, key: str) -> None:
        """Do what a key stands for; others do nothing."""
        act = _KEYS.get(key)
        if act is None:
            return
        self._pressed += 1
        self._player.command(act(self._player, f"key {self._pressed}"))


@contextmanager
def terminal(player: Player, stream: TextIO = sys.stdin) -> Iterator[bool]:
    """Listen to the keys of a terminal while the context lasts; whether there is one."""
    if not stream.isatty():
        yield False
        return
    import termios
    import tty

    before = termios.tcgetattr(stream)
    over = threading.Event()
    listener = threading.Thread(
        target=_listen, args=(stream, Keyboard(player), over.is_set), daemon=True
    )
    try:
        tty.setcbreak(stream)
        listener.start()
        yield True
    finally:
        over.set()
        with suppress(termios.error):
            termios.tcsetattr(stream, termios.TCSADRAIN, before)


def _listen(stream: TextIO, keyboard: Keyboard, is_over: Callable[[], bool]) -> None:
    while not is_over():
        ready, _, _ = select.select([stream], [], [], LOOK_S)
        if not ready:
            continue
        key = stream.read(1)
        if not key:
            return
        if key == _ESCAPE:
            key += stream.read(2)
        keyboard.press(key)


def _toggle(player: Player, name: str) -> PlayerCommand:
    return PlayerCommand(id=name, kind="resume" if player.state == "paused" else "pause")


def _step(player: Player, name: str) -> PlayerCommand:
    del player
    return PlayerCommand(id=name, kind="step")


def _quit(player: Player, name: str) -> PlayerCommand:
    del player
    return PlayerCommand(id=name, kind="stop")


def _skip(by_ns: int) -> _Act:
    def skip(player: Player, name: str) -> PlayerCommand:
        """Seek from where it stands."""
        return PlayerCommand(id=name, kind="seek", t_ns=max(0, player.t_ns + by_ns))

    return skip


def _scale(factor: float) -> _Act:
    """A replay at full speed comes down to the recorded pace."""

    def scale(player: Player, name: str) -> PlayerCommand:
        """Change the rate."""
        rate = player.rate * factor if player.rate != MAX else 1.0
        return PlayerCommand(id=name, kind="rate", rate=min(rate, 1e6))

    return scale


class _Act(Protocol):
    def __call__(self, player: Player, name: str) -> PlayerCommand:
        """The command that a key stands for."""


_ESCAPE = "\x1b"
_KEYS: Mapping[str, _Act] = {
    " ": _toggle,
    "s": _step,
    "q": _quit,
    f"{_ESCAPE}[C": _skip(SKIP_NS),
    f"{_ESCAPE}[D": _skip(-SKIP_NS),
    f"{_ESCAPE}[A": _scale(2.0),
    f"{_ESCAPE}[B": _scale(0.5),
}
