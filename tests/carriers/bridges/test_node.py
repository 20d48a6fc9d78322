"""A bridge as a process of a run, on the bus in memory: it joins, answers for itself, leaves."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from carriers.bridges.bridge import Bridge, Station
from carriers.bridges.feeds import Arrival
from carriers.bridges.jsonl import JsonLines
from carriers.bridges.node import BridgeNode, MemberOutlet
from carriers.bridges.run_clock import RunClock
from schemas import codec, keys
from schemas.bus.member import Buses, Member
from schemas.bus.memory_bus import MemoryNetwork
from schemas.messages import Closed, ProcessState, SourceReport
from sim_world.scenario import parse_scenario
from tests.carriers.bridges.outlets import POSE
from tests.whole.in_memory import MemoryRun
from tests.whole.recorded import messages, outputs
from tests.whole.refusing import refused

SCENARIO = Path(__file__).parents[2] / "whole" / "small.toml"
DEADLINE_S = 20.0


class Script:
    """A feed that brings what it is told to, when it is told."""

    ended = False

    def __init__(self) -> None:
        self._waiting: list[bytes] = []

    def bring(self, *lines: bytes) -> None:
        self._waiting.append(b"\n".join(lines))

    def take(self, timeout_s: float) -> list[Arrival]:
        taken, self._waiting = self._waiting, []
        if not taken:
            time.sleep(timeout_s)
        return [Arrival(0, data, whole=True) for data in taken]

    def close(self) -> None: ...


class Bridged:
    """A bridge in a thread."""

    def __init__(self, network: MemoryNetwork, epoch_ns: int | None = None) -> None:
        self.feed = Script()
        self.reason = ""
        member = Member("small", "harbour", Buses(network.bus("harbour"), network.bus("harbour")))
        clock = RunClock(epoch_ns)
        self.bridge = Bridge("harbour", MemberOutlet(member), Station(pose=POSE), clock.now_ns)
        self.node = BridgeNode(member, self.feed, JsonLines("harbour", "radar"), self.bridge, clock)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def join(self) -> None:
        self._thread.join(DEADLINE_S)
        assert not self._thread.is_alive()

    def _run(self) -> None:
        self.reason = self.node.run()


@contextmanager
def bridged(network: MemoryNetwork) -> Iterator[Bridged]:
    found = Bridged(network)
    yield found
    found.node.stop()
    found.join()


def asked(network: MemoryNetwork, enough: Callable[[dict[str, int]], bool]) -> dict[str, int]:
    """What the bridge answers who asks for its state, once it is enough."""
    bus = network.bus("viewer")
    deadline_s = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline_s:
        for sample in bus.query(keys.STATE.key("small", "harbour"), b"", "", 0.3):
            state = codec.decode(ProcessState, sample.payload, sample.encoding)
            if enough(state.counters):
                return state.counters
    raise AssertionError("never enough")


def test_who_asks_is_told_the_counts_by_field() -> None:
    good = b'{"bearing_deg": 4, "range_m": 70}'
    with MemoryNetwork() as network, bridged(network) as found:
        found.feed.bring(good, b"rubbish", b'{"range_m": -1}', good)
        counters = asked(network, lambda counters: counters["received"] == 4)
    assert counters["decoded"] == counters["rejected"] == 2
    assert (counters["rejected line"], counters["rejected range_m"]) == (1, 1)
    assert counters["published"] == 4  # SourceInfo and navigation beside the reports


def test_a_feed_that_has_ended_ends_the_bridge_after_all_could_be_fetched() -> None:
    with MemoryNetwork() as network:
        found = Bridged(network)
        found.feed.bring(b'{"bearing_deg": 4, "range_m": 70}')
        asked(network, lambda counters: counters["decoded"] == 1)
        found.feed.ended = True
        found.join()
    assert found.reason == "the feed has ended"


def test_it_takes_part_in_a_run_on_a_bus_that_loses_and_leaves_with_its_world(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.mcap"
    scenario = parse_scenario(SCENARIO.read_text(), SCENARIO.name)
    with MemoryNetwork(5, loss=0.1, duplicate=0.1, delay_s=(0.0, 0.01)) as network:
        found = Bridged(network, scenario.declared.epoch_ns)

        def feed_it(run: MemoryRun) -> None:
            for step in range(3, 28):
                run.await_step(step)
                found.feed.bring(json.dumps({"bearing_deg": step, "range_m": 70 + step}).encode())

        MemoryRun(scenario, network, path, rate=10.0).carry_out(feed_it)
        found.join()
    assert found.reason == "the run has ended"
    reports = [r for r in messages(path, keys.REPORT, SourceReport) if r.carrier == "harbour"]
    assert [report.seq for report in reports] == list(range(1, 26))
    claimed = {
        end.stream: end.last_seq
        for closed in messages(path, keys.CLOSED_FUSION, Closed)
        for end in closed.manifest
        if end.carrier == "harbour"
    }
    assert claimed["radar"] == 25
    assert claimed["info"] == 1
    assert outputs(path) == refused(path)
