"""`python -m carriers NAME`: one simulated carrier of a run as a process."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from schemas.bus.entry import leave, on_signal, pin_threads, run_process


def main() -> int:
    """Run one carrier until the world leaves."""
    pin_threads()
    options = _options()
    return run_process(options.name, lambda: _run(options))


def _run(options: Namespace) -> int:
    from schemas import codec, keys
    from schemas.bus.latched import fetch
    from schemas.bus.member import Buses, Member
    from schemas.bus.zenoh_bus import open_bus
    from schemas.messages import TruthScenario
    from sim_world.scenario import parse_scenario

    from .carrier import Carrier
    from .node import CarrierNode

    control = open_bus(options.connect, options.start_timeout)
    data = open_bus(options.connect, options.start_timeout)
    with control, data, Member(options.run, options.name, Buses(control, data)) as member:
        sample = fetch(data, keys.TRUTH_SCENARIO, options.run, timeout_s=options.start_timeout)
        truth = codec.decode(TruthScenario, sample.payload, sample.encoding)
        scenario = parse_scenario(truth.text, where=truth.name)
        node = CarrierNode(
            member,
            Carrier(scenario, options.name),
            delay_s=options.delay,
            hub_timeout_s=options.hub_timeout,
        )
        on_signal(node.stop)
        node.run()
    return 0


def _options() -> Namespace:
    parser = ArgumentParser(prog="python -m carriers", description=__doc__)
    parser.add_argument("name", help="of the carrier in the scenario")
    parser.add_argument("--run", required=True, help="name of the run")
    parser.add_argument("--connect", default="tcp/127.0.0.1:7447", help="endpoint of the hub")
    parser.add_argument("--start-timeout", type=float, default=30.0, help="seconds")
    parser.add_argument("--delay", type=float, default=0.0, help="wait up to so long in each step")
    parser.add_argument("--hub-timeout", type=float, default=120.0, help="seconds it may be away")
    return parser.parse_args()


if __name__ == "__main__":
    leave(main())
