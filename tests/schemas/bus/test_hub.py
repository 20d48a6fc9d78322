"""The hub as a process: where it listens, how it ends, hubs that join."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from schemas.bus.interface import Inbox, Sample
from schemas.bus.zenoh_bus import open_bus
from schemas.qos import DATA
from tests.hub_process import DEADLINE_S, ROOT, HubProcess
from tests.promptness import prompt, within
from tests.schemas.bus.bus_networks import eventually, take

pytestmark = pytest.mark.live


def test_a_free_port_is_taken_and_said() -> None:
    with HubProcess("tcp/127.0.0.1:0") as hub:
        assert hub.endpoint.startswith("tcp/127.0.0.1:")
        assert not hub.endpoint.endswith(":0")
        with open_bus(hub.endpoint) as bus:
            assert bus.link_up()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT], ids=lambda s: s.name)
@prompt
def test_a_signal_ends_it_cleanly_at_once(number) -> None:
    with HubProcess() as hub, open_bus(hub.endpoint):
        with within(0.5):
            assert hub.end(number) == 0
        hub.restart()


def test_a_taken_port_that_was_asked_for_is_an_error_that_says_what_to_do(hub: str) -> None:
    done = listen(hub)
    assert done.returncode == 2
    assert done.stderr.startswith(f"{hub} is taken; end the hub that runs there, or pass --listen")
    assert done.stderr.count("\n") == 1


def test_where_nobody_can_listen_is_an_error(hub: str) -> None:
    done = listen("nowhere")
    assert done.returncode == 2
    assert "nowhere: cannot listen there" in done.stderr


def test_a_taken_default_port_gives_a_free_one(hub: str) -> None:
    text = f"from schemas.bus.hub import run_hub; run_hub({hub!r}, strict=False)"
    with process("-c", text) as second:
        endpoint = first_line(second).split()[-1]
        assert endpoint != hub
        with open_bus(endpoint) as bus:
            assert bus.link_up()
        second.terminate()
        assert second.wait(DEADLINE_S) == 0


def test_joined_hubs_are_one_bus(hub: str) -> None:
    inbox: Inbox[Sample] = Inbox()
    with (
        HubProcess("tcp/127.0.0.1:0", "--connect", hub) as second,
        open_bus(hub) as near,
        open_bus(second.endpoint) as far,
        near.announce("joined/near"),
    ):
        assert eventually(lambda: far.tokens("joined/*") == ["joined/near"])
        near.subscribe("joined/x", inbox)
        near.serve("joined/asked", lambda question: [Sample(question.key, b"yes", "")])
        assert eventually(lambda: bool(far.query("joined/asked", b"", "", DEADLINE_S)))
        far.publish("joined/x", b"over", "", DATA)
        assert take(inbox, 1) == [Sample("joined/x", b"over", "")]


@prompt
def test_a_client_that_hangs_does_not_hold_up_the_end() -> None:
    """It has stopped reading, with megabytes under way to it."""
    text = """
import sys
from schemas.bus.interface import Inbox
from schemas.bus.zenoh_bus import open_bus
bus = open_bus(sys.argv[1])
bus.subscribe("flood", Inbox())
print("ready", flush=True)
sys.stdin.read()
"""
    with HubProcess() as hub, process("-c", text, hub.endpoint) as client:
        assert first_line(client) == "ready\n"
        client.send_signal(signal.SIGSTOP)
        with open_bus(hub.endpoint) as bus:
            for _ in range(10):
                bus.publish("flood", bytes(1_000_000), "", DATA)
            with within(0.5):
                assert hub.end(signal.SIGTERM) == 0
            hub.restart()


@contextmanager
def process(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    started = subprocess.Popen(
        [sys.executable, *arguments],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield started
    finally:
        started.kill()
        started.communicate()


def first_line(started: subprocess.Popen[str]) -> str:
    assert started.stdout is not None
    return started.stdout.readline()


def listen(endpoint: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "schemas.bus.hub", "--listen", endpoint]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=DEADLINE_S, check=False
    )
