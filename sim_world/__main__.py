"""`python -m sim_world SCENARIO`: the world of a run as a process."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from schemas.bus.entry import leave, on_signal, pin_threads, run_process


def main() -> int:
    """Run the world to its end."""
    pin_threads()
    options = _options()
    return run_process("world", lambda: _run(options))


def _run(options: Namespace) -> int:
    from schemas import keys
    from schemas.bus.member import Buses, Member
    from schemas.bus.zenoh_bus import open_bus

    from .node import Pace, WorldNode
    from .scenario import load_scenario, parse_override
    from .world import World

    overrides = dict(parse_override(text) for text in options.set)
    scenario = load_scenario(options.scenario, overrides, options.data)
    run = options.run or scenario.declared.name
    pace = Pace(
        rate=None if options.rate == "max" else float(options.rate),
        start_timeout_s=options.start_timeout,
        step_timeout_s=options.step_timeout,
        hub_timeout_s=options.hub_timeout,
    )
    control = open_bus(options.connect, options.start_timeout)
    data = open_bus(options.connect, options.start_timeout)
    with control, data, Member(run, keys.WORLD, Buses(control, data)) as member:
        node = WorldNode(World(scenario), scenario.declared, scenario.truth, member, pace)
        on_signal(lambda: node.stop("interrupted"))
        node.run()
    return 0


def _options() -> Namespace:
    parser = ArgumentParser(prog="python -m sim_world", description=__doc__)
    parser.add_argument("scenario", help="TOML file")
    parser.add_argument("--connect", default="tcp/127.0.0.1:7447", help="endpoint of the hub")
    parser.add_argument("--run", help="name of the run, by default the scenario's")
    parser.add_argument("--rate", default="max", help="max (lock-step) or a multiple of real time")
    parser.add_argument("--set", action="append", default=[], help="scenario key=value")
    parser.add_argument("--data", help="folder of recorded tracks")
    parser.add_argument("--start-timeout", type=float, default=30.0, help="seconds")
    parser.add_argument("--step-timeout", type=float, default=10.0, help="seconds")
    parser.add_argument("--hub-timeout", type=float, default=120.0, help="seconds it may be away")
    return parser.parse_args()


if __name__ == "__main__":
    leave(main())
