"""A replay under way: it plays, waits, skips and stops as it is told, from any thread."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Literal, NamedTuple

from schemas.messages import PlayerCommand, PlayerStatus
from schemas.recording.reader import Recorded

from .pace import MAX, Lateness, Pace
from .playlist import Playlist

MOST_ANSWERS = 256
SHOW_EVERY = 128
"""Messages of a replay that never waits between two looks at who watches."""
State = Literal["waiting", "playing", "paused", "ended"]


Outlet = Callable[[Recorded], None]
"""Where messages go."""


class Played(NamedTuple):
    """What a replay has done."""

    messages: int
    took_s: float
    lateness: Lateness
    ended: str


class Player:
    """Plays a list at a pace.

    Args:
        publish: where messages go.
        rate: multiple of the recorded pace; `MAX` = as fast as it goes.
        loop: begin again at the end, until it is told to stop.
        paused: wait to be told.
        delay_s: before the first message.
        watch: is told now and then that something has changed.
    """

    def __init__(
        self,
        playlist: Playlist,
        publish: Outlet,
        *,
        rate: float = 1.0,
        loop: bool = False,
        paused: bool = False,
        delay_s: float = 0.0,
        watch: Callable[[], None] = lambda: None,
    ) -> None:
        self._playlist, self._publish = playlist, publish
        self._pace, self._loop, self._delay_s = Pace(rate), loop, delay_s
        self._watch = watch
        self._changed = threading.Condition()
        self._paused, self._steps = paused, 0
        self._seek_ns: int | None = None
        self._stop = ""
        self._free = False
        self._stepping_ns: int | None = None
        self._answers: OrderedDict[str, PlayerStatus] = OrderedDict()
        self.state: State = "waiting"
        self.t_ns = playlist.first_ns
        self.sent = 0

    @property
    def rate(self) -> float:
        """Multiple of the recorded pace; `MAX` = as fast as it goes."""
        return self._pace.rate

    def command(self, command: PlayerCommand) -> PlayerStatus:
        """Do what is asked; how it stands then. A command that is repeated does nothing twice."""
        with self._changed:
            if command.kind == "status":
                return self.status(command.id)
            answer = self._answers.get(command.id)
            if answer is None:
                refused = self._refusal(command)
                if not refused:
                    self._take(command)
                answer = self._answers[command.id] = self.status(command.id, refused)
                while len(self._answers) > MOST_ANSWERS:
                    self._answers.popitem(last=False)
            return answer

    def stop(self, reason: str) -> None:
        """Ask for the end."""
        with self._changed:
            self._stop = self._stop or reason
            self._settle()

    def status(self, name: str = "", refused: str = "") -> PlayerStatus:
        """How it stands."""
        return PlayerStatus(
            id=name,
            taken=not refused,
            reason=refused,
            state=self.state,
            t_ns=self.t_ns,
            start_ns=self._playlist.start_ns,
            end_ns=self._playlist.end_ns,
            rate=self.rate,
            sent=self.sent,
        )

    def run(self) -> Played:
        """Play to the end, or until it is stopped.

        Raises:
            RecordingError: the recording is damaged; all before that has been published.
        """
        with self._changed:
            self._changed.wait_for(lambda: bool(self._stop), self._delay_s)
            self.state = "paused" if self._paused else "playing"
            self._settle()
        started_s = time.monotonic()
        t_ns = self._playlist.first_ns
        while not self._stop:
            self._play_from(t_ns)
            seek_ns, self._seek_ns = self._seek_ns, None
            if seek_ns is None and not self._loop:
                break
            t_ns = self._playlist.first_ns if seek_ns is None else seek_ns
        self.state = "ended"
        took_s = time.monotonic() - started_s
        return Played(self.sent, took_s, self._pace.lateness(), self._stop or "finished")

    def _play_from(self, t_ns: int) -> None:
        """Latched values first, then what follows, until the end or another order."""
        self._pace.restart()
        self.t_ns = t_ns
        with self._changed:
            self._settle()
        latched = self._playlist.before(t_ns)
        for message in latched:
            self._publish(message)
        self.sent += len(latched)
        time_ns, publish = self._playlist.time_ns, self._publish
        for message in self._playlist.messages(t_ns):
            now_ns = time_ns(message)
            if not self._free and not self._may_go(now_ns):
                return
            publish(message)
            self.t_ns = now_ns
            self.sent += 1
            if self.sent % SHOW_EVERY == 0:
                self._watch()

    def _may_go(self, t_ns: int) -> bool:
        """Wait until a message is due; false if something else is to be played instead."""
        with self._changed:
            while not self._stop and self._seek_ns is None:
                if self._paused:
                    if self._may_step(t_ns):
                        return True
                    self._pace.restart()
                    self._changed.wait()
                    continue
                now_s = time.monotonic()
                due_s = self._pace.due_s(t_ns, now_s)
                if now_s >= due_s:
                    self._pace.went(now_s - due_s)
                    return True
                self._watch()
                self._changed.wait(due_s - now_s)
            return False

    def _may_step(self, t_ns: int) -> bool:
        """Whether a message belongs to the instant that a paused replay was told to step to."""
        if t_ns != self._stepping_ns and self._steps:
            self._steps -= 1
            self._stepping_ns = t_ns
        return t_ns == self._stepping_ns

    def _refusal(self, command: PlayerCommand) -> str:
        if self.state == "ended":
            return "the replay has ended"
        if command.kind == "seek" and command.t_ns is None:
            return "seek: no t_ns"
        if command.kind == "rate" and command.rate is None:
            return "rate: no rate"
        if command.kind == "step" and not self._paused:
            return "step: it is not paused"
        return ""

    def _take(self, command: PlayerCommand) -> None:
        if command.kind in ("pause", "resume"):
            self._paused = command.kind == "pause"
            self._stepping_ns, self._steps = None, 0
        elif command.kind == "step":
            self._steps += 1
        elif command.kind == "seek" and command.t_ns is not None:
            self._seek_ns = self.t_ns = self._playlist.within(command.t_ns)
            self._stepping_ns = None
        elif command.kind == "rate" and command.rate is not None:
            self._pace.rate = command.rate
            self._pace.restart()
        elif command.kind == "stop":
            self._stop = self._stop or "told to stop"
        self._settle()

    def _settle(self) -> None:
        """After any change: whether messages may pass without a look, and wake who waits."""
        waits = self._paused or self._seek_ns is not None or bool(self._stop)
        self._free = self.rate == MAX and not waits
        if self.state in ("playing", "paused"):
            self.state = "paused" if self._paused else "playing"
        self._changed.notify_all()
