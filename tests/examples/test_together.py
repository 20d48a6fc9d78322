"""Commands of the pages that need each other: a run, who joins it, and who looks on."""

from __future__ import annotations

import signal
import socket
from contextlib import ExitStack
from pathlib import Path
from subprocess import Popen

import pytest

from schemas.recording.reader import open_recording
from tests.project.pages import DEADLINE_S, Place, at, blocks, commands
from tests.project.test_documents import TOGETHER

PUBLISHING = "docs/publishing.md"
HERE = [
    "crossfix run scenarios/strait.toml --rate 2",
    "crossfix peek 'report/short/*' --run strait",
    "python examples/external_publisher.py --run strait",
    "crossfix check --run strait --carrier short",
    "crossfix bridge status harbour --run strait",
    "crossfix bridge jsonl --out --run strait --topic correction --topic report",
]
BRIDGED = [
    "mosquitto_sub -t radar/plots | crossfix bridge jsonl - ",
    "crossfix bridge jsonl --udp 127.0.0.1:8600 ",
    "crossfix bridge jsonl --tcp 127.0.0.1:8601 ",
]
AS = "--run strait --as carrier=harbour,source=radar --position 36.01,-5.6,20"
BRIDGES = [begin + AS for begin in BRIDGED]
LINE = '{"bearing_deg": [41.2], "range_m": [5300], "track_id": ["17"]}'
ELSEWHERE = ("crossfix check --recording recordings/strait.mcap", "echo ")
"""Run by `tests/project/test_documents.py`, and by `test_examples.py`."""
ENOUGH = {"peek": " --count 1", "check": " --seconds 3", "jsonl --out": " --count 2"}
"""Endless commands are told to stop after so much."""


def test_every_command_of_the_page_on_publishing_is_run() -> None:
    here = {*HERE, *BRIDGES}
    for command in commands(PUBLISHING):
        assert command in here or command.startswith(ELSEWHERE), command
    assert here <= set(commands(PUBLISHING))


@pytest.fixture
def place(tmp_path: Path) -> Place:
    place = Place(tmp_path, duration_s=1800)
    (short,) = blocks(PUBLISHING, "python")
    (tmp_path / "short.py").write_text(short)
    return place


def enough(command: str) -> str:
    return command + next((more for word, more in ENOUGH.items() if word in command), "")


def free_port(kind: socket.SocketKind) -> str:
    with socket.socket(type=kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return str(probe.getsockname()[1])


def ended(process: Popen[str]) -> tuple[int, str]:
    out, err = process.communicate(timeout=DEADLINE_S)
    return process.returncode, out + err


@pytest.mark.live
@pytest.mark.slow
def test_commands_that_join_a_run_do_what_the_pages_say(place: Place, hub: str) -> None:
    """Everybody joins one run at once; who answers at once is asked in the middle of it."""
    tcp, udp = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
    piped, datagrams, connected = BRIDGES
    guests = [
        f"python short.py strait {hub}",
        at(hub, "python examples/external_publisher.py --run strait"),
        at(hub, datagrams.replace(":8600", f":{udp}")),
        at(hub, connected.replace(":8601", f":{tcp}").replace("harbour", "quay")),
    ]
    with socket.create_server(("127.0.0.1", int(tcp))), ExitStack() as stack:
        run = stack.enter_context(place.started(at(hub, HERE[0])))
        assert place.run(at(hub, "crossfix peek step --run strait --count 1")).returncode == 0
        joined = [stack.enter_context(place.started(command)) for command in guests]
        for command in HERE[1:]:
            if "external_publisher" in command:
                continue
            done = place.run(enough(at(hub, command)))
            assert done.returncode == 0, (command, done.stdout, done.stderr)
            assert done.stdout
        sent = piped.replace("mosquitto_sub -t radar/plots", f"echo '{LINE}'")
        done = place.run(at(hub, sent.replace("harbour", "pier")))
        assert "received 1, decoded 1, rejected 0" in done.stderr
        for command in ("crossfix check --run strait --carrier visitor", TOGETHER[3]):
            done = place.run(enough(at(hub, command)))
            assert done.returncode == 0, (command, done.stdout, done.stderr)
        run.send_signal(signal.SIGINT)  # however long that took, it is enough
        for process in (run, *joined):
            code, told = ended(process)
            assert code == 0, told
    with open_recording(place.folder / "recordings" / "strait.mcap") as recording:
        heard = " ".join(recording.index.channels[n].topic for n in recording.index.channels)
        assert all(f"report/{name}/" in heard for name in ("short", "visitor", "pier"))


@pytest.mark.live
def test_a_run_started_by_hand_on_several_machines(tmp_path: Path) -> None:
    place = Place(tmp_path, duration_s=20)
    listen, world, levante, fusion = TOGETHER[5:]
    with ExitStack() as stack:
        hub = stack.enter_context(place.started(listen.replace("0.0.0.0:7447", "0.0.0.0:0")))
        assert hub.stdout is not None
        port = hub.stdout.readline().rpartition(":")[2].strip()
        carriers = [levante.replace("levante", n) for n in ("levante", "poniente", "siroco")]
        processes = [
            stack.enter_context(place.started(at(f"tcp/127.0.0.1:{port}", command)))
            for command in (fusion, *carriers, world)
        ]
        for process in processes:
            code, told = ended(process)
            assert code == 0, told
        hub.send_signal(signal.SIGTERM)
        assert ended(hub)[0] == 0
    with open_recording(tmp_path / "recordings" / "spread.mcap") as recording:
        assert recording.end is not None
        assert (recording.end.reason, recording.end.gaps) == ("finished", 0)
