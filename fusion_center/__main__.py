"""`python -m fusion_center`: the fusion centre of a run as a process, with its recorder."""

from __future__ import annotations

import time
from argparse import ArgumentParser, Namespace
from pathlib import Path

from schemas.bus.entry import leave, on_signal, pin_threads, run_process


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
                recorder_member, options.output, options.max_loss, options.start_timeout
            )
            with recorder:
                node = FusionNode(
                    member,
                    scenario,
                    settings_from(scenario.fusion),
                    recorder,
                    lateness_s=options.lateness,
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


def _options() -> Namespace:
    parser = ArgumentParser(prog="python -m fusion_center", description=__doc__)
    parser.add_argument("--run", required=True, help="name of the run")
    parser.add_argument("--connect", default="tcp/127.0.0.1:7447", help="endpoint of the hub")
    parser.add_argument("--output", type=Path, required=True, help="recording to write")
    parser.add_argument("--max-loss", type=float, default=0.25, help="seconds a crash may cost")
    parser.add_argument("--lateness", type=float, default=0.2, help="seconds a paced step waits")
    parser.add_argument("--delay", type=float, default=0.0, help="seconds to waste in each step")
    parser.add_argument("--start-timeout", type=float, default=30.0, help="seconds")
    return parser.parse_args()


if __name__ == "__main__":
    leave(main())
