"""Carries out `crossfix record`: options into limits, a member of the run, the words at the end."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from crossfix.commands.record import RecordOptions
from crossfix.new_file import new_recording, require_new
from fusion_center.recorder import How, Wanted, require_wanted
from fusion_center.recorder.alone import RecorderAlone, record_whatever
from schemas.bus.entry import on_signal
from schemas.bus.member import Buses, Member
from schemas.bus.patience import HubPatience
from schemas.bus.zenoh_bus import open_bus
from schemas.errors import CrossfixError
from schemas.recording.parts import Limits, Safety, parts_of

HUB_S = 5.0
MEGABYTE = 10**6
DISK_FAILED = 3
"""Exit code, as that of the fusion centre whose recorder failed."""


def carry_out(run: str, options: RecordOptions) -> int:
    """Record until the end; the exit code.

    Raises:
        CrossfixError: options that mean nothing, no hub, a file that cannot be made.
    """
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    how = how_of(options)
    path = _new(options.output, run)
    with (
        open_bus(options.connect, HUB_S) as control,
        open_bus(options.connect, HUB_S) as data,
        Member(run, options.name, Buses(control, data)) as member,
    ):
        alone = record_whatever(member, path, how, options.wait)
        alone.recorder.paused = options.start_paused
        alone.hub = HubPatience(options.hub_timeout)
        on_signal(lambda: alone.stop("interrupted"))
        alone.start()
        console.print(f"recording: {', '.join(map(str, alone.recorder.files()))}")
        reason = alone.run(options.duration or float("inf"))
        console.print(told(alone, reason))
        alone.hub.require()
        return DISK_FAILED if alone.recorder.error() else 0


def how_of(options: RecordOptions) -> How:
    """The options, understood.

    Raises:
        CrossfixError: they contradict each other, or an expression is none.
    """
    limits = Limits(
        part_bytes=round(options.split_size * MEGABYTE),
        part_s=options.split_time,
        keep=options.keep or 0,
        min_free_bytes=round(options.min_free * MEGABYTE),
    )
    if limits.keep and not limits.splits:
        raise CrossfixError("--keep", expected="--split-size or --split-time with it")
    wanted = Wanted(options.include, options.exclude, options.regex)
    return How(limits, Safety(options.max_loss, options.fsync), require_wanted(wanted))


def told(alone: RecorderAlone, reason: str) -> str:
    """What was recorded, in a line."""
    counters = alone.recorder.counters()
    lost = f", {counters['dropped']} dropped, {counters['gaps']} never had"
    is_whole = not (counters["dropped"] or counters["gaps"])
    return f"{counters['recorded']} messages recorded{'' if is_whole else lost}: {reason}"


def _new(output: Path | None, run: str) -> Path:
    """Where it goes; neither it nor a part of it may be there.

    Raises:
        LaunchError: it is, or cannot be made.
    """
    if output is None:
        return new_recording(run)
    for part in parts_of(output) if output.parent.is_dir() else ():
        require_new(part)
    return require_new(output)
