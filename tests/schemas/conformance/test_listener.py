"""Listening on a bus: our own carriers are clean; what only an answer shows is asked for."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from schemas import codec, keys
from schemas.bus.memory_bus import MemoryBus, MemoryNetwork
from schemas.bus.outbox import Outbox
from schemas.conformance import Conformance, Finding, Listener, listening
from schemas.messages import Ack, Navigation, Pose, SourceInfo, SourceProperties, SourceReport
from sim_world.scenario import load_scenario
from tests.whole.in_memory import MemoryRun

STRAIT = Path(__file__).parents[3] / "scenarios" / "strait.toml"
RUN, NAME, BOOT = "trial", "visitor", "b00t"
PERIOD_S = 0.05
PROPERTIES = SourceProperties(
    period_s=PERIOD_S, sigma_bearing_rad=0.005, sigma_range_m=30.0, range_max_m=3e4
)
Send = Callable[[int], None]


@pytest.fixture(autouse=True)
def _brisk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listening, "ASK_S", 0.3)


@pytest.fixture
def network() -> Iterator[MemoryNetwork]:
    with MemoryNetwork() as network:
        yield network


def test_our_own_carriers_pass_without_a_warning(tmp_path: Path) -> None:
    scenario = load_scenario(STRAIT, {"time.duration_s": 30})
    heard: list[Conformance] = []

    def listen(run: MemoryRun) -> None:
        heard.append(Listener(run.network.bus("checker"), run.run, None).listen(60.0))

    with MemoryNetwork(1, delay_s=(0.0, 0.01)) as network:
        MemoryRun(scenario, network, tmp_path / "run.mcap", rate=10.0).carry_out(listen)
    (conformance,) = heard
    assert conformance.findings() == []
    assert len({carrier for carrier, _ in conformance.heard()}) == 3
    assert len(conformance.sigma_checks()) == 3


def visitor(bus: MemoryBus | _Mute, *, step: int = 0) -> tuple[Outbox, Send]:
    """A publisher by our own outbox, and how it says everything of one instant."""
    outbox = Outbox(RUN, NAME, BOOT, bus, bus)  # type: ignore[arg-type]

    def send(number: int) -> None:
        now = {"carrier": NAME, "boot": BOOT, "step": step and number, "t_ns": time.time_ns()}
        if number == 1:
            info = SourceInfo(**now, stream="info", seq=1, source="radar", properties=PROPERTIES)  # type: ignore[arg-type]
            outbox.send(keys.SOURCE, (NAME, "radar"), info)
        pose = Pose(latitude_rad=0.6, longitude_rad=0.1, covariance=[1.0, 0, 0, 1.0, 0, 1e-4])
        navigation = Navigation(**now, stream="navigation", seq=number, pose=pose)  # type: ignore[arg-type]
        outbox.send(keys.NAVIGATION, (NAME,), navigation)
        report = SourceReport(**now, stream="radar", seq=number)  # type: ignore[arg-type]
        outbox.send(keys.REPORT, (NAME, "radar"), report)

    return outbox, send


@contextmanager
def publishing(send: Send) -> Iterator[None]:
    over = threading.Event()

    def work() -> None:
        number = 0
        while not over.wait(PERIOD_S):
            number += 1
            send(number)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def told(network: MemoryNetwork, seconds: float = 1.0) -> set[tuple[str, str]]:
    findings: list[Finding] = Listener(network.bus("checker"), RUN, NAME).listen(seconds).findings()
    # The pace of a thread on a busy machine is not what is tried here.
    timing = {"time_jitter", "rate", "empty_reports"}
    return {(f.code, f.source) for f in findings if f.code not in timing}


def test_a_publisher_that_answers_is_clean(network: MemoryNetwork) -> None:
    bus = network.bus(NAME)
    _, send = visitor(bus)
    with bus.announce(keys.alive(RUN, NAME, BOOT)), publishing(send):
        assert told(network) == set()


def test_losses_on_the_way_are_not_the_publishers_fault(network: MemoryNetwork) -> None:
    network.faults = network.faults._replace(loss=0.2)
    bus = network.bus(NAME)
    _, send = visitor(bus)
    with bus.announce(keys.alive(RUN, NAME, BOOT)), publishing(send):
        assert told(network) == set()


def test_no_token_no_backfill_and_no_latched_value_are_told(network: MemoryNetwork) -> None:
    bus = network.bus(NAME)
    _, send = visitor(_Mute(bus))
    with publishing(send):
        assert told(network, 2.0) == {("token", ""), ("backfill", ""), ("latched", "radar")}


def test_steps_that_nobody_acknowledges_are_told(network: MemoryNetwork) -> None:
    bus = network.bus(NAME)
    _, send = visitor(bus, step=1)

    def with_others_ack(number: int) -> None:
        send(number)
        ack = Ack(process="alpha", boot="a", step=number)
        key = keys.ACK.key(RUN, "alpha")
        bus.publish(key, codec.encode(ack), codec.encoding_of(Ack), keys.ACK.qos)

    with bus.announce(keys.alive(RUN, NAME, BOOT)), publishing(with_others_ack):
        assert told(network) == {("unanswered", "")}


def test_two_live_processes_with_one_name_are_told(network: MemoryNetwork) -> None:
    bus, twin = network.bus(NAME), network.bus("twin")
    _, send = visitor(bus)
    other = Outbox(RUN, NAME, "other", twin, twin)

    def both(number: int) -> None:
        send(number)
        pose = Pose(latitude_rad=0.6, longitude_rad=0.1, covariance=[1.0, 0, 0, 1.0, 0, 1e-4])
        other.send(
            keys.NAVIGATION,
            (NAME,),
            Navigation(
                carrier=NAME,
                boot="other",
                stream="navigation",
                seq=number,
                t_ns=time.time_ns(),
                pose=pose,
            ),
        )

    with (
        bus.announce(keys.alive(RUN, NAME, BOOT)),
        twin.announce(keys.alive(RUN, NAME, "other")),
        publishing(both),
    ):
        assert ("two_processes", "") in told(network)


class _Mute:
    """A session on which nothing is ever served."""

    def __init__(self, bus: MemoryBus) -> None:
        self.publish = bus.publish

    def serve(self, key: str, handler: object) -> None:
        """Not."""
