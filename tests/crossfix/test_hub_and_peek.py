"""`hub` and `peek` as processes: what is published is printed, and Ctrl-C ends them cleanly."""

import json
import signal

import msgpack
import pytest

from crossfix.commands.peek import read
from schemas.bus.zenoh_bus import open_bus
from schemas.qos import DATA
from tests.crossfix.conftest import DEADLINE_S, Crossfix, started

KEY = "crossfix/@v1/demo/report/alpha/radar"


@pytest.mark.live
@pytest.mark.timeout(60)
def test_peek_prints_what_is_published(hub: str) -> None:
    message = {"carrier": "alpha", "bearing_rad": [0.5] * 20, "nothing": None}
    with started("peek", "report/**", "--connect", hub, "--count", "1", "--json") as peeking:
        assert peeking.stderr is not None
        assert "listening" in peeking.stderr.readline()
        with open_bus(hub) as bus:
            bus.publish(
                "crossfix/@v1/demo/navigation/alpha", b"", "", DATA
            )  # not of this expression
            bus.publish(KEY, msgpack.packb(message), "application/msgpack;crossfix.X", DATA)
            out, _ = peeking.communicate(timeout=DEADLINE_S)
    assert peeking.returncode == 0
    assert json.loads(out) == {
        "key": KEY,
        "encoding": "application/msgpack;crossfix.X",
        "message": message,
    }


@pytest.mark.live
@pytest.mark.timeout(60)
def test_ctrl_c_ends_a_hub_with_success() -> None:
    with started("hub", "--listen", "tcp/127.0.0.1:0") as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("listening on")
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=DEADLINE_S) == 0


@pytest.mark.live
def test_without_a_hub_peek_says_how_to_start_one(crossfix: Crossfix) -> None:
    shown = crossfix("peek", "--connect", "tcp/127.0.0.1:1")
    assert shown.code == 2
    assert "crossfix hub" in shown.err


@pytest.mark.parametrize(
    ("payload", "encoding", "message"),
    [
        (b'{"a": [1, null]}', "application/json", {"a": [1, None]}),
        (msgpack.packb({"a": b"\x00"}), "application/msgpack", {"a": b"\x00"}),
        (msgpack.packb({1: 2}), "", {"1": 2}),
    ],
)
def test_read(payload: bytes, encoding: str, message: object) -> None:
    assert read(payload, encoding) == message


@pytest.mark.parametrize("payload", [b"", b"\xc1", b"\x92\x01", b"\x01\x02"])
def test_what_cannot_be_read_is_said_and_never_raised(payload: bytes) -> None:
    assert read(payload, "application/msgpack").startswith("unreadable")
    assert read(payload, "application/json").startswith("unreadable")
