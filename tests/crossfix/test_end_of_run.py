"""A hub that ends with its run: not before the run, not before its last process, not never."""

from __future__ import annotations

import signal
import subprocess
import threading
from contextlib import ExitStack

import pytest

from crossfix.end_of_run import attendance, await_end, dialled
from schemas import keys
from schemas.bus.memory_bus import MemoryNetwork
from schemas.bus.zenoh_bus import open_bus
from schemas.errors import LaunchError
from tests.crossfix.conftest import DEADLINE_S, Crossfix, started

RUN = "demo"


class Watched:
    """`await_end` in a thread, and the processes of its run."""

    def __init__(self, leave_s: float) -> None:
        network = MemoryNetwork()
        self._network, self._here = network, attendance(network.bus("hub"), RUN)
        self.ended = threading.Event()
        self._thread = threading.Thread(target=self._await, args=(leave_s,), daemon=True)
        self._thread.start()

    def alive(self, process: str) -> ExitStack:
        life = ExitStack()
        bus = self._network.bus(process)
        life.enter_context(bus.announce(keys.alive(RUN, process, "b0")))
        return life

    def _await(self, leave_s: float) -> None:
        await_end(self._here, RUN, DEADLINE_S, leave_s)
        self.ended.set()


def test_it_ends_when_the_last_carrier_has_left_after_world_and_fusion_centre() -> None:
    watched = Watched(leave_s=DEADLINE_S)
    carrier = watched.alive("alpha")  # first come, last gone
    with watched.alive(keys.WORLD), watched.alive(keys.FUSION):
        assert not watched.ended.wait(0.3)
    assert not watched.ended.wait(0.5)
    carrier.close()
    assert watched.ended.wait(DEADLINE_S)


def test_a_world_that_leaves_before_the_fusion_centre_ends_nothing() -> None:
    watched = Watched(leave_s=0.0)
    with watched.alive(keys.RECORDER):
        with watched.alive(keys.WORLD):
            assert not watched.ended.wait(0.3)
        assert not watched.ended.wait(0.5)
    assert watched.ended.wait(DEADLINE_S)


def test_a_stranger_that_stays_is_not_waited_for_without_end() -> None:
    watched = Watched(leave_s=0.2)
    with watched.alive("stranger"):
        with watched.alive(keys.WORLD):
            assert not watched.ended.wait(0.3)
        assert watched.ended.wait(DEADLINE_S)


def test_a_run_that_does_not_begin_is_an_error_that_says_what_to_do() -> None:
    with pytest.raises(LaunchError, match=r"run demo: no world came in 0\.2 s; .*crossfix world"):
        await_end(set, RUN, 0.2)


@pytest.mark.parametrize(
    ("listened", "reached"),
    [
        ("tcp/0.0.0.0:7447", "tcp/127.0.0.1:7447"),
        ("tcp/[::]:7447", "tcp/[::1]:7447"),
        ("tcp/192.0.2.7:7447", "tcp/192.0.2.7:7447"),
    ],
)
def test_dialled(listened: str, reached: str) -> None:
    assert dialled(listened) == reached


@pytest.mark.live
@pytest.mark.timeout(60)
def test_the_hub_process_ends_with_its_run() -> None:
    arguments = ("--listen", "tcp/127.0.0.1:0", "--until-run-ends", RUN)
    with started("hub", *arguments) as process:
        assert process.stdout is not None
        endpoint = process.stdout.readline().split()[-1]
        world = keys.alive(RUN, keys.WORLD, "b0")
        still_there = pytest.raises(subprocess.TimeoutExpired)
        with open_bus(endpoint) as bus, bus.announce(world), still_there:
            process.wait(0.5)
        assert process.wait(DEADLINE_S) == 0


@pytest.mark.live
@pytest.mark.timeout(60)
def test_a_signal_ends_it_before_its_run() -> None:
    with started("hub", "--listen", "tcp/127.0.0.1:0", "--until-run-ends", RUN) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGTERM)
        assert process.wait(DEADLINE_S) == 0


@pytest.mark.live
def test_its_exit_code_tells_that_there_was_no_run(crossfix: Crossfix) -> None:
    shown = crossfix(
        "hub", "--listen=tcp/127.0.0.1:0", "--until-run-ends", RUN, "--start-timeout=0.3"
    )
    assert shown.code == 2
    assert "no world came in 0.3 s" in shown.err
