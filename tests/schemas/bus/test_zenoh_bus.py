"""Zenoh's own ways of failing: a hub that dies, hangs or is not there, exits, busy processes."""

import contextlib
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Iterator, Sequence

import pytest

from schemas.bus.interface import Inbox, Liveness, Sample
from schemas.bus.zenoh_bus import CLOSE_S, ZenohBus, open_bus
from schemas.codec import MAX_PAYLOAD_BYTES
from schemas.errors import BusError
from schemas.qos import DATA
from tests.hub_process import DEADLINE_S, ROOT, HubProcess
from tests.promptness import LateError, prompt, within
from tests.schemas.bus.bus_networks import eventually, take

pytestmark = pytest.mark.live


@pytest.fixture
def own_hub() -> Iterator[HubProcess]:
    """A hub that the test may kill."""
    with HubProcess() as process:
        yield process


@contextlib.contextmanager
def program(text: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A Python process that has printed `ready`."""
    command = [sys.executable, "-c", textwrap.dedent(text), *arguments]
    process = subprocess.Popen(
        command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield process
    finally:
        process.kill()
        process.communicate()


HOLDER = """
    import sys
    from schemas.bus.zenoh_bus import open_bus
    with open_bus(sys.argv[1]) as bus, bus.announce("alive/holder/1"):
        print("ready", flush=True)
        sys.stdin.read()
"""


@pytest.mark.parametrize("death", [signal.SIGKILL, signal.SIGTERM], ids=lambda s: s.name)
@prompt
def test_all_is_back_within_a_second_of_the_hub(own_hub: HubProcess, death) -> None:
    tokens: Inbox[Liveness] = Inbox()
    samples: Inbox[Sample] = Inbox()
    with open_bus(own_hub.endpoint) as near, open_bus(own_hub.endpoint) as far:
        near.subscribe("law/**", samples)
        far.serve("law/asked", lambda question: [Sample(question.key, b"yes", "")])
        with far.announce("alive/far"):
            near.watch("alive/**", tokens)
            assert take(tokens, 1) == [Liveness("alive/far", True, True)]

            own_hub.end(death)
            assert take(tokens, 1) == [Liveness("alive/far", False, False)]
            assert eventually(lambda: not (near.link_up() or far.link_up()))
            far.publish("law/lost", b"", "", DATA)
            assert near.query("law/asked", b"", "", 0.2) == []
            assert near.tokens("alive/**") == []
            threading.Event().wait(1.5)  # long enough for the retries to have slowed down

            own_hub.restart()
            yes = Sample("law/asked", b"yes", "")
            with within(1.0):
                assert take(tokens, 1) == [Liveness("alive/far", True, True)]
                assert eventually(lambda: near.link_up() and far.link_up())
                assert near.query("law/asked", b"", "", DEADLINE_S) == [yes]
                far.publish("law/found", b"", "", DATA)
                assert take(samples, 1) == [Sample("law/found", b"", "")]


def test_the_hub_knows_what_is_declared_when_declaring_returns(hub: str) -> None:
    """Even when the declaration queues behind megabytes on its way to the hub."""
    with open_bus(hub) as near, open_bus(hub) as far:
        for n in range(10):
            inbox: Inbox[Sample] = Inbox()
            near.publish("ballast", bytes(MAX_PAYLOAD_BYTES), "", DATA)
            near.subscribe(f"declared/{n}", inbox)
            far.publish(f"declared/{n}", b"", "", DATA)
            near.publish("ballast", bytes(MAX_PAYLOAD_BYTES), "", DATA)
            near.serve(f"asked/{n}", lambda question: [Sample(question.key, b"", "")])
            assert len(far.query(f"asked/{n}", b"", "", DEADLINE_S)) == 1
            assert len(take(inbox, 1)) == 1


@prompt
def test_kill_9_of_a_token_holder_is_seen_at_once(hub: str) -> None:
    tokens: Inbox[Liveness] = Inbox()
    with open_bus(hub) as viewer, program(HOLDER, hub) as holder:
        viewer.watch("alive/holder/*", tokens)
        assert take(tokens, 1) == [Liveness("alive/holder/1", True, True)]
        holder.kill()
        with within(0.5):
            assert take(tokens, 1) == [Liveness("alive/holder/1", False, True)]


@prompt
def test_a_hung_token_holder_is_seen_after_the_lease(hub: str) -> None:
    tokens: Inbox[Liveness] = Inbox()
    with open_bus(hub) as viewer, program(HOLDER, hub) as holder:
        viewer.watch("alive/holder/*", tokens)
        assert len(take(tokens, 1)) == 1
        holder.send_signal(signal.SIGSTOP)
        with within(2.5):
            assert take(tokens, 1) == [Liveness("alive/holder/1", False, True)]


LEAVES_IT_OPEN = """
    import sys
    from schemas.bus.interface import Inbox
    from schemas.bus.zenoh_bus import open_bus
    bus = open_bus(sys.argv[1])
    inbox = Inbox()
    bus.subscribe("noise/**", inbox)
    bus.watch("alive/**", Inbox())
    bus.serve("asked", lambda _: [])
    held = bus.announce("alive/it")
    held.__enter__()
    while not inbox.take(5):
        pass
    print("ready", flush=True)
    sys.stdin.read(1)
    if sys.argv[2] == "error":
        raise SystemExit(7)
"""


@pytest.mark.parametrize(("way", "code"), [("end", 0), ("error", 7)])
def test_a_process_that_leaves_its_bus_open_exits_at_once(hub: str, way: str, code: int) -> None:
    stop = threading.Event()
    with open_bus(hub) as noisy:

        def make_noise() -> None:
            while not stop.is_set():
                noisy.publish("noise/x", bytes(2000), "", DATA)

        noise = threading.Thread(target=make_noise)
        noise.start()
        for _ in range(3):
            with program(LEAVES_IT_OPEN, hub, way) as process:
                process.communicate("\n", timeout=DEADLINE_S)
                assert process.returncode == code
        stop.set()
        noise.join()


@prompt
def test_no_hub_says_what_to_do_in_time() -> None:
    what_to_do = r"no hub at tcp/127.0.0.1:1; start one with `crossfix hub`"
    with within(1.0), pytest.raises(BusError, match=what_to_do):
        open_bus("tcp/127.0.0.1:1", timeout_s=0.3)


@pytest.mark.parametrize("endpoint", ["127.0.0.1:7447", "", "tcp"])
def test_what_is_no_endpoint_is_said(endpoint: str) -> None:
    with pytest.raises(BusError, match="tcp/HOST:PORT"):
        open_bus(endpoint, timeout_s=0.3)


def test_a_hub_that_starts_later_is_waited_for(own_hub: HubProcess) -> None:
    own_hub.end(signal.SIGKILL)
    opened: list[ZenohBus] = []
    opening = threading.Thread(target=lambda: opened.append(open_bus(own_hub.endpoint, DEADLINE_S)))
    opening.start()
    own_hub.restart()
    opening.join()
    with opened[0] as bus:
        assert bus.link_up()


@prompt
def test_a_hung_hub_holds_up_neither_opening_nor_closing() -> None:
    with HubProcess() as hub, open_bus(hub.endpoint) as bus:
        hub.process.send_signal(signal.SIGSTOP)
        with pytest.raises(BusError, match="no hub"):
            open_bus(hub.endpoint, timeout_s=0.3)
        with within(1.0):
            for _ in range(4):
                bus.publish("law/stuck", bytes(MAX_PAYLOAD_BYTES), "", DATA)
        with within(CLOSE_S + 0.5):
            bus.close()


@prompt
def test_a_process_that_computes_still_gets_its_samples(hub: str) -> None:
    """2000 samples at 2000/s while another thread never lets go of the interpreter by itself."""
    inbox: Inbox[Sample] = Inbox()
    busy = True

    def compute() -> None:
        number = 0
        while busy:
            number += 1

    noise = """
        import sys, time
        from schemas.bus.zenoh_bus import open_bus
        from schemas.qos import DATA
        with open_bus(sys.argv[1]) as bus:
            print("ready", flush=True)
            sys.stdin.read(1)
            for number in range(2000):
                bus.publish("law/busy", bytes(2000), "", DATA)
                if number % 4 == 0:
                    time.sleep(0.002)
            print("done", flush=True)
            sys.stdin.read()
    """
    with open_bus(hub) as bus, program(noise, hub) as sender:
        bus.subscribe("law/busy", inbox)
        computing = threading.Thread(target=compute)
        computing.start()
        assert sender.stdin is not None
        assert sender.stdout is not None
        sender.stdin.write("\n")
        sender.stdin.flush()
        assert sender.stdout.readline() == "done\n"
        try:
            with within(2.0):
                arrived = len(take(inbox, 1901))
            if arrived < 1901:
                raise LateError(f"{2000 - arrived} of 2000 samples dropped before they were read")
        finally:
            busy = False
            computing.join()


def test_tests_and_interface_do_not_import_zenoh() -> None:
    text = """
        import sys, schemas.bus.interface, schemas.bus.memory_bus
        assert not [name for name in sys.modules if name.startswith("zenoh")]
        print("ready", flush=True)
    """
    with program(text):
        pass


class Counted(Inbox[Sample]):
    """An inbox that counts how often it is woken."""

    woken = 0

    def put_all(self, items: Sequence[Sample], sizes: Sequence[int]) -> None:
        self.woken += 1
        super().put_all(items, sizes)


def test_what_may_gather_wakes_the_reader_seldom_and_comes_whole(own_hub: HubProcess) -> None:
    with open_bus(own_hub.endpoint) as sender, open_bus(own_hub.endpoint) as receiver:
        gathered, single = Counted(gather_s=0.1), Counted()
        receiver.subscribe("gather", gathered)
        receiver.subscribe("gather", single)
        for number in range(100):
            sender.publish("gather", str(number).encode(), "", DATA)
            time.sleep(0.001)
        assert [int(s.payload) for s in take(gathered, 100)] == list(range(100))
        assert len(take(single, 100)) == 100
    assert 3 * gathered.woken < single.woken
