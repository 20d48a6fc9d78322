"""A player plays each message once, in order, at its time, and does what it is told meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from crossfix.replaying.controls import Keyboard
from crossfix.replaying.pace import MAX, Pace
from crossfix.replaying.player import Played, Player
from crossfix.replaying.playlist import NS, Choice, Playlist
from schemas import keys
from schemas.errors import CrossfixError
from schemas.keys import Role
from schemas.messages import PlayerCommand, PlayerStatus
from schemas.recording.reader import Recorded, Recording, open_recording
from tests.crossfix.small_recording import STEPS, record
from tests.promptness import LateError, prompt

DEADLINE_S = 60.0
ROLES = (Role.INPUT, Role.OUTPUT)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Recording]:
    """Messages at the seconds 1 to STEPS."""
    path = tmp_path_factory.mktemp("replay") / "small.mcap"
    record(path)
    with open_recording(path) as opened:
        yield opened


def everything(recording: Recording) -> list[Recorded]:
    return list(recording.messages(roles=ROLES))


class Playing:
    """A player in a thread; what it has published."""

    def __init__(self, recording: Recording, choice: Choice | None = None, **how: Any) -> None:
        self.playlist = Playlist(recording, choice or Choice(ROLES))
        self.heard: list[Recorded] = []
        self.player = Player(self.playlist, self.heard.append, **how)
        self.played: Played | None = None
        self._commands = 0
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Playing:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.player.stop("the test is over")
        self._thread.join(DEADLINE_S)
        assert not self._thread.is_alive()

    def _run(self) -> None:
        self.played = self.player.run()

    def tell(self, kind: str, **fields: Any) -> PlayerStatus:
        self._commands += 1
        name = fields.pop("id", f"c{self._commands}")
        return self.player.command(PlayerCommand(id=name, kind=kind, **fields))  # type: ignore[arg-type]

    def until(self, met: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + DEADLINE_S
        while not met():
            assert time.monotonic() < deadline_s, f"it never came so far: {len(self.heard)}"
            time.sleep(0.001)

    def end(self) -> Played:
        self._thread.join(DEADLINE_S)
        assert self.played is not None
        return self.played

    def instants(self) -> list[int]:
        """Seconds of what was heard since the last call, each once."""
        heard, self.heard[:] = list(self.heard), []
        start_ns = self.playlist.start_ns
        return sorted({(m.log_time_ns - start_ns) // NS + 1 for m in heard})


def test_everything_is_played_once_in_its_order(recording: Recording) -> None:
    with Playing(recording, rate=MAX) as playing:
        played = playing.end()
    assert playing.heard == everything(recording)
    assert played.messages == len(playing.heard)
    assert played.ended == "finished"


@prompt
def test_the_pace_is_that_of_the_recording(recording: Recording) -> None:
    times_s: list[float] = []
    playlist = Playlist(recording, Choice(ROLES))
    player = Player(playlist, lambda _: times_s.append(time.monotonic()), rate=50.0)
    played = player.run()
    messages = everything(recording)
    for heard_s, message in zip(times_s, messages, strict=True):
        due_s = times_s[0] + (message.log_time_ns - messages[0].log_time_ns) / NS / 50.0
        assert heard_s >= due_s - 1e-3
        if heard_s >= due_s + 0.2:
            raise LateError(f"{heard_s - due_s:.2f} s")
    assert 0 <= played.lateness.median_s <= played.lateness.most_s


def test_only_inputs_unless_told_otherwise(recording: Recording) -> None:
    with Playing(recording, Choice(), rate=MAX) as playing:
        playing.end()
    assert {m.address.topic.role for m in playing.heard} == {Role.INPUT}


@pytest.mark.parametrize(
    ("choice", "seconds"),
    [
        (Choice(ROLES, until_s=2.0), [1, 2]),
        (Choice(ROLES, start_s=3.0), [4, 5, 6]),
        (Choice(ROLES, start_s=1.0, duration_s=2.0), [2, 3]),
        (Choice(ROLES, start_s=1.0, until_s=4.0, duration_s=1.0), [2]),
        (Choice(ROLES, start_s=STEPS - 1.0), [STEPS]),
    ],
)
def test_a_part_of_it(recording: Recording, choice: Choice, seconds: list[int]) -> None:
    with Playing(recording, choice, rate=MAX) as playing:
        playing.end()
    latched = Playlist(recording, choice).before(playing.playlist.first_ns)
    assert playing.heard[: len(latched)] == latched
    del playing.heard[: len(latched)]
    assert playing.instants() == seconds


@pytest.mark.parametrize(
    "choice", [Choice(start_s=100.0), Choice(until_s=1.0, start_s=2.0), Choice((Role.TRUTH,), 7.0)]
)
def test_nothing_to_replay_is_an_error(recording: Recording, choice: Choice) -> None:
    with pytest.raises(CrossfixError, match="nothing to replay"):
        Playlist(recording, choice)


def test_latched_values_come_first_after_a_seek(recording: Recording) -> None:
    messages = everything(recording)
    with Playing(recording, paused=True) as playing:
        seek_ns = playing.playlist.start_ns + 3 * NS
        playing.until(lambda: playing.player.state == "paused")
        assert playing.tell("seek", t_ns=seek_ns).taken
        latched = {m.key for m in messages if m.address.topic.latched and m.log_time_ns < seek_ns}
        assert latched
        playing.until(lambda: len(playing.heard) == len(latched))
        assert {m.key for m in playing.heard} == latched
        for found in playing.heard:
            before = [m for m in messages if m.key == found.key and m.log_time_ns < seek_ns]
            assert found == before[-1]
        playing.heard.clear()
        playing.tell("rate", rate=MAX)
        playing.tell("resume")
        playing.end()
        assert playing.heard == [m for m in messages if m.log_time_ns >= seek_ns]


def test_a_seek_back_plays_again(recording: Recording) -> None:
    with Playing(recording, paused=True) as playing:
        playing.until(lambda: playing.player.state == "paused")
        for _ in range(3):
            playing.tell("step")
        playing.until(lambda: playing.player.t_ns >= playing.playlist.start_ns + 2 * NS)
        playing.tell("seek", t_ns=0)  # before the beginning: there
        playing.tell("step")
        playing.until(lambda: playing.player.t_ns == playing.playlist.start_ns)
        playing.tell("rate", rate=MAX)
        playing.heard.clear()
        playing.tell("seek", t_ns=0)
        playing.tell("resume")
        playing.end()
        assert playing.heard == everything(recording)


def test_a_step_plays_one_instant(recording: Recording) -> None:
    with Playing(recording, paused=True) as playing:
        playing.until(lambda: playing.player.state == "paused")
        for second in range(1, STEPS + 1):
            expected = [
                m
                for m in everything(recording)
                if m.log_time_ns == playing.playlist.start_ns + (second - 1) * NS
            ]
            playing.tell("step")
            playing.until(lambda expected=expected: len(playing.heard) == len(expected))  # type: ignore[misc]
            assert playing.heard == expected
            playing.heard.clear()


def test_a_pause_holds_it_and_costs_no_message(recording: Recording) -> None:
    with Playing(recording, rate=20.0) as playing:
        playing.until(lambda: bool(playing.heard))
        assert playing.tell("pause").state == "paused"
        count = len(playing.heard)
        time.sleep(0.15)  # three seconds of the recording
        assert len(playing.heard) <= count + 1  # one may have been on its way
        assert playing.tell("resume").state == "playing"
        playing.end()
    assert playing.heard == everything(recording)


def test_another_rate_holds_from_then_on(recording: Recording) -> None:
    with Playing(recording, rate=0.001) as playing:
        playing.until(lambda: bool(playing.heard))
        assert playing.tell("rate", rate=1000.0).rate == 1000.0
        playing.end()
    assert playing.heard == everything(recording)


def test_a_loop_begins_again_until_it_is_stopped(recording: Recording) -> None:
    count = len(everything(recording))
    with Playing(recording, rate=MAX, loop=True) as playing:
        playing.until(lambda: len(playing.heard) > 3 * count)
        playing.tell("stop")
        assert playing.end().ended == "told to stop"
    assert playing.heard[count : 2 * count] == everything(recording)


def test_a_delay_comes_before_the_first_message(recording: Recording) -> None:
    started_s = time.monotonic()
    with Playing(recording, rate=MAX, delay_s=0.1) as playing:
        playing.until(lambda: bool(playing.heard))
    assert time.monotonic() - started_s >= 0.1


def test_a_repeated_command_does_nothing_twice(recording: Recording) -> None:
    with Playing(recording, paused=True) as playing:
        playing.until(lambda: playing.player.state == "paused")
        first = playing.tell("step", id="same")
        assert playing.tell("step", id="same") == first
        expected = sum(m.log_time_ns == playing.playlist.start_ns for m in everything(recording))
        playing.until(lambda: len(playing.heard) >= expected)
        time.sleep(0.02)
        assert len(playing.heard) == expected


@pytest.mark.parametrize(("kind", "why"), [("seek", "no t_ns"), ("rate", "no rate")])
def test_what_cannot_be_done_is_refused(recording: Recording, kind: str, why: str) -> None:
    with Playing(recording, rate=0.001) as playing:
        answer = playing.tell(kind)
        assert not answer.taken
        assert why in answer.reason
        assert "not paused" in playing.tell("step").reason


def test_after_the_end_nothing_is_taken(recording: Recording) -> None:
    with Playing(recording, rate=MAX) as playing:
        playing.end()
        assert not playing.tell("pause").taken
        assert playing.tell("status").state == "ended"


def test_keys_of_the_terminal(recording: Recording) -> None:
    with Playing(recording, rate=0.001) as playing:
        keyboard = Keyboard(playing.player)
        playing.until(lambda: bool(playing.heard))
        for key, state in ((" ", "paused"), (" ", "playing"), (" ", "paused"), ("x", "paused")):
            keyboard.press(key)
            assert playing.player.state == state
        keyboard.press("\x1b[A")
        assert playing.player.rate == 0.002
        keyboard.press("\x1b[B")
        assert playing.player.rate == 0.001
        keyboard.press("\x1b[C")  # ten seconds on are beyond the end
        playing.until(lambda: playing.player.t_ns > playing.playlist.end_ns or playing.played is not None)  # fmt: skip  # noqa: E501
        keyboard.press("q")
        assert playing.end().ended in ("told to stop", "finished")


def test_by_stamp_what_was_sent_first_goes_first(recording: Recording) -> None:
    playlist = Playlist(recording, Choice(ROLES, by_stamp=True))
    stamps = [m.publish_time_ns for m in playlist.messages(playlist.first_ns)]
    assert stamps == sorted(stamps)
    assert len(stamps) == len(everything(recording))
    assert (playlist.start_ns, playlist.end_ns) == (stamps[0], stamps[-1])


def test_closings_come_before_what_follows_them(recording: Recording) -> None:
    with Playing(recording, rate=MAX) as playing:
        playing.end()
    topics = [m.address.topic for m in playing.heard]
    assert topics.index(keys.CLOSED_FUSION) < topics.index(keys.CORRECTION)


def test_a_pace_is_kept_without_drifting() -> None:
    pace = Pace(10.0)
    assert [pace.due_s(10**18 + tenth * NS, 5.0 + 0.1 * tenth) for tenth in range(3)] == [
        pytest.approx(5.0),
        pytest.approx(5.1),
        pytest.approx(5.2),
    ]
    assert pace.due_s(10**18 + NS, 99.0) == pytest.approx(5.1)  # what is past stays where it was


def test_max_never_waits() -> None:
    pace = Pace(MAX)
    assert [pace.due_s(hour * 3600 * NS, 7.0) for hour in range(10)] == [7.0] * 10
