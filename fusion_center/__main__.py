"""`python -m fusion_center`: the fusion centre of a run as a process, with its recorder."""

from __future__ import annotations

import time
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from schemas.bus.entry import leave, on_signal, pin_threads, run_process

if TYPE_CHECKING:
    from .recorder import How

MEGABYTE = 10**6


def main() -> int:
    """Fuse and record a run to its end."""
    pin_threads()
    options = _options()
    return run_process("fusion", lambda: _run(options))


def _run(options: Namespace) -> int:
    from schemas import keys
    from schemas.bus.member import Buses, Member
    from schemas.bus.zenoh_bus import open_bus

    from .process.node import FusionNode
    from .recorder import record_run
    from .settings import settings_from

    def session() -> Buses:
        return Buses(*(open_bus(options.connect, options.start_timeout) for _ in range(2)))

    buses, recorder_buses = session(), session()
    try:
        with (
            Member(options.run, keys.FUSION, buses) as member,
            Member(options.run, keys.RECORDER, recorder_buses) as recorder_member,
        ):
            recorder, scenario = record_run(
                recorder_member,
                options.output,
                options.max_loss,
                options.start_timeout,
                _how(options),
            )
            with recorder:
                node = FusionNode(
                    member,
                    scenario,
                    settings_from(scenario.fusion),
                    recorder,
                    lateness_s=options.lateness,
                    hub_timeout_s=options.hub_timeout,
                    delay=lambda: time.sleep(options.delay),
                )
                on_signal(lambda: node.stop("interrupted"))
                node.run()
            if recorder.error():
                return 3
    finally:
        recorder_buses.close()
        buses.close()
    return 0


def _how(options: Namespace) -> How:
    """How the recording lies on the disk."""
    from schemas.recording.parts import Limits, Safety

    from .recorder import How

    limits = Limits(
        part_bytes=round(options.split_size * MEGABYTE),
        part_s=options.split_time,
        keep=options.keep,
        min_free_bytes=round(options.min_free * MEGABYTE),
    )
    return How(limits, Safety(fsync=options.fsync))


def _options() -> Namespace:
    parser = ArgumentParser(prog="python -m fusion_center", description=__doc__)
    parser.add_argument("--run", required=True, help="name of the run")
    parser.add_argument("--connect", default="tcp/127.0.0.1:7447", help="endpoint of the hub")
    parser.add_argument("--output", type=Path, required=True, help="recording to write")
    parser.add_argument("--max-loss", type=float, default=0.25, help="seconds a crash may cost")
    parser.add_argument("--lateness", type=float, default=0.2, help="seconds a paced step waits")
    parser.add_argument("--delay", type=float, default=0.0, help="seconds to waste in each step")
    parser.add_argument("--start-timeout", type=float, default=30.0, help="seconds")
    parser.add_argument("--fsync", choices=("none", "flush", "end"), default="none")
    parser.add_argument("--split-size", type=float, default=0.0, help="megabytes of a part")
    parser.add_argument("--split-time", type=float, default=0.0, help="seconds of a part")
    parser.add_argument("--keep", type=int, default=0, help="parts, older ones are deleted")
    parser.add_argument("--min-free", type=float, default=0.0, help="megabytes left on the disk")
    parser.add_argument("--hub-timeout", type=float, default=120.0, help="seconds it may be away")
    return parser.parse_args()


if __name__ == "__main__":
    leave(main())
