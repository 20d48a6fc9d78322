"""A replay from its options to its last word."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import msgspec
from rich.console import Console

from crossfix.commands.replay import ReplayOptions
from schemas import keys
from schemas.bus.entry import on_signal
from schemas.bus.member import Buses, Member
from schemas.bus.zenoh_bus import open_bus
from schemas.errors import CrossfixError
from schemas.recording.reader import Recording, open_recording

from .conducting import World, await_tokens, world_boot
from .controls import HELP, serve, terminal
from .pace import MAX
from .player import Outlet, Played, Player
from .playlist import Choice, Playlist
from .remapping import renames_of
from .showing import progress_line, published_clock
from .speaking import Speaker, refuse_if_alive

HUB_S = 3.0


class Outcome(msgspec.Struct):
    """What a replay did, as `--json` prints it."""

    run: str
    messages: int
    took_s: float
    late_median_s: float
    late_p99_s: float
    late_most_s: float
    ended: str


def carry_out(path: Path, options: ReplayOptions) -> int:
    """Replay a recording; the exit code.

    Raises:
        CrossfixError: the recording, the hub, or an option.
    """
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    with (
        open_recording(path) as recording,
        open_bus(options.connect, HUB_S) as control,
        open_bus(options.connect, HUB_S) as data,
    ):
        run = options.run or recording.header.run
        refuse_if_alive(recording, run, data)
        played = _play(recording, run, Buses(control, data), options, console)
    _tell(run, played, options, console)
    return 0


def choice_of(options: ReplayOptions) -> Choice:
    """Which messages the options name.

    Raises:
        CrossfixError: they contradict each other.
    """
    roles = tuple(keys.Role(one) for one in options.role)
    if options.as_world:
        if options.role != ("input",) or options.start or options.loop:
            raise CrossfixError("--as-world", expected="no --role, --start or --loop with it")
        roles = (keys.Role.INPUT, keys.Role.TRUTH)
    return Choice(roles, options.start, options.until, options.duration, options.order == "stamp")


def _play(
    recording: Recording, run: str, buses: Buses, options: ReplayOptions, console: Console
) -> Played:
    choice = choice_of(options)
    playlist = Playlist(recording, choice)
    with ExitStack() as stack:
        speaker = Speaker(buses.data, run, renames_of(options.remap))
        speaker.prepare(recording, choice.roles)
        speak: Outlet = speaker
        if options.as_world:
            member = stack.enter_context(Member(run, keys.WORLD, buses))
            speak = stack.enter_context(_as_world(member, recording, speak, options))
        await_tokens(buses.control, run, options.wait_for, options.wait_timeout)
        player = Player(
            playlist,
            speak,
            rate=MAX if options.rate == "max" else float(options.rate),
            loop=options.loop,
            paused=options.start_paused,
            delay_s=options.delay,
        )
        serve(player, buses.control, run, options.name)
        on_signal(lambda: player.stop("interrupted"))
        stack.enter_context(published_clock(player, buses.data, run, options.name, options.clock))
        if stack.enter_context(terminal(player)) and not options.json:
            console.print(HELP)
        stack.enter_context(progress_line(player, run, console))
        return player.run()


@contextmanager
def _as_world(
    member: Member, recording: Recording, speak: Outlet, options: ReplayOptions
) -> Iterator[Outlet]:
    if boot := world_boot(recording):
        member.boot = boot
        member.outbox.begin(boot)
    world = World(member, recording, speak)
    with world.present(options.wait_timeout):
        yield world


def _tell(run: str, played: Played, options: ReplayOptions, console: Console) -> None:
    late = played.lateness
    if options.json:
        outcome = Outcome(run, played.messages, played.took_s, *late, ended=played.ended)
        print(msgspec.json.encode(outcome).decode())
        return
    console.print(
        f"{played.messages} messages of run {run} in {played.took_s:.1f} s, {played.ended}; "
        f"late by {1000 * late.median_s:.2f} ms (median), {1000 * late.most_s:.1f} ms (at most)"
    )
