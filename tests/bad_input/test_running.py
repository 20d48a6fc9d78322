"""Everything bad at once on a running scenario: the same bytes as without, and all of it told."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from schemas import codec, keys
from schemas.bus.interface import Bus, Sample
from schemas.bus.memory_bus import MemoryNetwork
from schemas.bus.zenoh_bus import open_bus
from schemas.errors import BusError, WireError
from schemas.messages import (
    Ack,
    BackfillRequest,
    Closed,
    Command,
    Health,
    Navigation,
    Pose,
    Step,
    StreamEnd,
)
from schemas.recording.reader import open_recording
from sim_world.scenario import Scenario, parse_scenario
from tests.bad_input.payloads import Chaos
from tests.live.live_run import LiveRun
from tests.whole.in_memory import MemoryRun
from tests.whole.recorded import messages, outputs
from tests.whole.refusing import refused

SMALL = Path(__file__).parents[1] / "whole" / "small.toml"
PATROL = Path(__file__).parents[1] / "live" / "patrol.toml"
LIVE_FLOOD = 20_000


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    logging.disable(logging.WARNING)
    yield
    logging.disable(logging.NOTSET)


@pytest.fixture(scope="module")
def small() -> Scenario:
    return parse_scenario(SMALL.read_text(), SMALL.name)


@pytest.fixture(scope="module")
def quiet(small: Scenario, tmp_path_factory: pytest.TempPathFactory) -> list[tuple[str, bytes]]:
    path = tmp_path_factory.mktemp("quiet") / "run.mcap"
    with MemoryNetwork() as network:
        MemoryRun(small, network, path).carry_out()
    return outputs(path)


def put(bus: Bus, samples: Iterable[Sample]) -> int:
    """Publish what a bus takes; how many that was."""
    taken = 0
    for sample in samples:
        try:
            bus.publish(*sample, keys.REPORT.qos)
        except (WireError, BusError):
            continue
        taken += 1
    return taken


def of(topic: keys.Topic, run: str, ids: tuple[str, ...], message: object) -> Sample:
    kind = type(message)
    return Sample(topic.key(run, *ids), codec.encode(message), codec.encoding_of(kind))  # type: ignore[arg-type]


def forgeries(run: str) -> Iterator[Sample]:
    """Whole messages that claim to be the world's, the fusion centre's or a carrier's."""
    everything = StreamEnd(carrier="alpha", boot="forged", stream="radar", last_seq=2**62)
    for step in (1, 2, 5, 2**62):
        yield of(keys.STEP, run, (), Step(boot="forged", step=step, t_ns=step, ended="by me"))
        yield of(keys.STEP, run, (), Step(boot="forged", step=step, t_ns=2**62, mode="paced"))
        closed = Closed(step=step, t_ns=7, manifest=[everything], lost=["alpha", "bravo"])
        yield of(keys.CLOSED_WORLD, run, (), closed)
        for who in ("fusion", "alpha", "bravo"):
            ack = Ack(process=who, boot="forged", step=step, manifest=[everything])
            yield of(keys.ACK, run, ("mallory",), ack)
            yield of(keys.ACK, run, (who,), ack)
    for seq in range(1, 30):
        pose = Pose(latitude_rad=0.0, longitude_rad=0.0)
        for step in (0, seq):
            navigation = Navigation(
                carrier="alpha", boot=f"forged{seq % 7}", stream="navigation", seq=seq, step=step,
                t_ns=1_767_225_600 * 10**9 + seq * 10**9, pose=pose,
            )  # fmt: skip
            yield of(keys.NAVIGATION, run, ("alpha",), navigation)


def questions(bus: Bus, run: str) -> None:
    """Ask for what cannot be had, and order what cannot be done."""
    for process in ("world", "alpha", "fusion"):
        key = keys.BACKFILL.key(run, process)
        request = BackfillRequest(boot="", stream="truth/targets", first=1, last=2**63 - 1)
        for payload in (b"", b"\xff" * 50, codec.encode(request)):
            bus.query(key, payload, "", 0.3)
    command = Command(id="x", kind="set", setting="own", value="mallory")
    for payload in (b"\xc1", codec.encode(command), b"\x81\xa2id" + b"\xda\xff\xff" + b"x" * 65535):
        bus.query(keys.COMMAND.key(run, keys.FUSION), payload, "", 0.3)


def test_a_flood_in_memory_changes_no_byte_and_is_told(
    small: Scenario, quiet: list[tuple[str, bytes]], tmp_path: Path
) -> None:
    path = tmp_path / "flooded.mcap"

    def flood(run: MemoryRun) -> None:
        run.await_step(3)
        bus = run.network.bus("mallory")
        with ExitStack() as tokens:
            for name in ("world", "fusion", "recorder"):  # gone again in a moment
                tokens.enter_context(bus.announce(keys.alive(run.run, name, "forged")))
        put(bus, forgeries(run.run))
        put(bus, Chaos(4, run.run).samples(3000))
        questions(bus, run.run)

    with MemoryNetwork() as network:
        run = MemoryRun(small, network, path, step_timeout_s=60.0)
        run.fusion_delay_s = 0.05  # so that the flood finds it running
        run.carry_out(flood)
    assert outputs(path) == quiet
    assert outputs(path) == refused(path)
    told = list(messages(path, keys.HEALTH, Health))[-1]
    reasons = {(row.carrier, row.stream): row.reason for row in told.streams if row.rejected}
    assert {"alpha", "bravo", "mallory", "world", "unknown"} <= {name for name, _ in reasons}
    assert {("world", "step"), ("world", "closed_world")} <= reasons.keys()
    news = [line for health in messages(path, keys.HEALTH, Health) for line in health.news]
    assert any("mallory publishes, but shows no liveliness token" in line for line in news)
    with open_recording(path) as recording:
        assert recording.end is not None
        assert recording.end.reason == "finished"
        assert (recording.end.dropped, recording.end.gaps) == (0, 0)
        assert recording.end.rejected > 300
        assert any(name.startswith("alpha/") for name in recording.end.rejections)


@pytest.mark.parametrize("name", ["alpha", "mallory"])
def test_a_member_gone_mad_harms_its_own_name_only(
    small: Scenario, tmp_path: Path, name: str
) -> None:
    """It has a token, leaps in seq, lies when it is asked, and perhaps bears another's name."""
    path = tmp_path / "mad.mcap"

    def mad(run: MemoryRun) -> None:
        run.await_step(3)
        bus = run.network.bus("mad")
        lie = b"\x81\xa7records\x91\xc0"
        bus.serve(keys.BACKFILL.key(run.run, name), lambda key, _: [Sample(key, lie, "")])
        with bus.announce(keys.alive(run.run, name, "mad")):
            for seq in (1, 2, 4, 2**40, 2**62):
                navigation = Navigation(
                    carrier=name, boot="mad", stream="navigation", seq=seq,
                    t_ns=small.declared.epoch_ns + 5 * 10**9,
                    pose=Pose(latitude_rad=0.1, longitude_rad=0.1),
                )  # fmt: skip
                put(bus, [of(keys.NAVIGATION, run.run, (name,), navigation)])
            run.await_step(12)

    with MemoryNetwork() as network:
        MemoryRun(small, network, path, rate=20.0).carry_out(mad)
    steps = list(messages(path, keys.CLOSED_FUSION, Closed))
    assert [closed.step for closed in steps] == list(range(1, 31))
    assert outputs(path) == refused(path)
    last = max(end.last_seq for c in steps for end in c.manifest if end.carrier == "bravo")
    assert last == 30


@pytest.mark.live
@pytest.mark.timeout(200)
def test_a_live_flood_changes_no_byte(tmp_path: Path) -> None:
    still, path = tmp_path / "still.mcap", tmp_path / "flooded.mcap"
    with LiveRun(PATROL, still) as run:
        assert run.await_end() == 0, run.lines[-30:]
    with LiveRun(PATROL, path) as run:
        run.await_step(2)
        with open_bus(run.endpoint) as bus:
            sent = flooded(bus, run.run, lambda: run.code is None)
        assert run.await_end() == 0, run.lines[-30:]
    assert sent >= LIVE_FLOOD
    assert outputs(path) == outputs(still)
    assert outputs(path) == refused(path)
    with open_recording(path) as recording:
        assert recording.end is not None
        assert recording.end.reason == "finished"
        assert recording.end.rejected > 0


def flooded(bus: Bus, run: str, goes_on: Callable[[], bool]) -> int:
    """The whole flood, even if the run should end before it does."""
    sent = put(bus, forgeries(run))
    threading.Thread(target=questions, args=(bus, run), daemon=True).start()
    sent += put(bus, Chaos(5, run).samples(int(1.1 * LIVE_FLOOD)))
    assert goes_on() or sent
    return sent
