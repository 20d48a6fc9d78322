"""Programs that are not ours take part in a run, as real processes over real Zenoh."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from itertools import chain
from math import hypot, isnan, radians
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from crossfix.commands.run import RunOptions
from crossfix.evaluation import frame_errors
from crossfix.evaluation.frames import said_errors
from crossfix.evaluation.recordings import frame_summaries
from examples import external_publisher as example
from schemas import keys
from schemas.messages import Closed, Correction, Navigation, SourceReport, TruthCarriers
from schemas.recording.reader import open_recording
from tests.live.live_run import LiveRun
from tests.live.outsiders import (
    DEADLINE_S,
    FaultyServer,
    await_line,
    bridge_options,
    seen,
    started,
)
from tests.whole.recorded import messages, outputs
from tests.whole.refusing import refused

pytestmark = pytest.mark.live
SCENARIO = Path(__file__).with_name("patrol.toml")
STEPS = 60
SLOW = RunOptions(delay=0.1)
NEES_LIMIT = 21.1
"""Of three degrees of freedom: exceeded once in 10,000."""


def visitor(run: LiveRun, *options: str) -> AbstractContextManager[subprocess.Popen[str]]:
    """The example as its user starts it."""
    where = ["--run", run.run, "--connect", run.endpoint]
    return started("examples/external_publisher.py", *where, *options)


def truths(path: Path) -> list[TruthCarriers]:
    """Where all carriers truly are, the example, by its own word, among them."""
    return [
        replace(
            truth,
            carrier=[*truth.carrier, "visitor"],
            position_m=[*truth.position_m, list(example.TRULY_AT_M)],
            velocity_mps=[*truth.velocity_mps, [0.0, 0.0, 0.0]],
            acceleration_mps2=[*truth.acceleration_mps2, [0.0, 0.0, 0.0]],
            north_error_rad=[*truth.north_error_rad, example.NORTH_ERROR_RAD],
            clock_offset_s=[*truth.clock_offset_s, 0.0],
        )
        for truth in messages(path, keys.TRUTH_CARRIERS, TruthCarriers)
    ]


def nees_of_visitor(path: Path) -> list[float]:
    """NEES of the applied corrections against where the example says that it truly is."""
    with open_recording(path) as recording:
        scenario = recording.scenario
    corrections = messages(path, keys.CORRECTION, Correction)
    errors = frame_errors(scenario, "alpha", [*truths(path), *corrections])["visitor"]
    return [error.nees for error in errors if error.state == "applied"]


def said_by_visitor(path: Path) -> list[float]:
    """How far off the visitor says to be, wherever it says so with a correction [m]."""
    with open_recording(path) as recording:
        scenario = recording.scenario
    said = messages(path, keys.NAVIGATION, Navigation)
    return said_errors(scenario, "alpha", [*truths(path), *said])["visitor"]


def assert_right_once_corrected(path: Path) -> None:
    """A visitor that uses its corrections is where it says, and says so as it should."""
    said = said_by_visitor(path)
    assert len(said) >= STEPS / 3
    assert np.sqrt(np.mean(np.square(said))) < hypot(*example.POSITION_ERROR_M) / 20
    reports = [r for r in messages(path, keys.REPORT, SourceReport) if r.carrier == "visitor"]
    turned = [r.turned_rad for r in reports if r.correction_id]
    assert len(turned) >= STEPS / 3
    own = truths(path)[-1]
    between = example.NORTH_ERROR_RAD - own.north_error_rad[own.carrier.index("alpha")]
    assert turned[-1] == pytest.approx(between, abs=radians(0.3))
    checking = [sys.executable, "-m", "crossfix", "check", "--recording", str(path), "--json"]
    done = subprocess.run([*checking, "--carrier", "visitor"], capture_output=True, check=False)
    found = {finding["code"] for finding in json.loads(done.stdout)["findings"]}
    assert not {code for code in found if code.startswith("correction")}


@pytest.mark.parametrize(
    ("how", "options"),
    [
        pytest.param(SLOW, ["--answer-steps"], id="answers steps"),
        pytest.param(SLOW, [], id="answers none", marks=pytest.mark.slow),
        pytest.param(RunOptions(rate="20"), [], id="paced", marks=pytest.mark.slow),
        pytest.param(
            SLOW,
            ["--answer-steps", "--use-corrections"],
            id="uses its corrections",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_example_is_recorded_and_gets_a_right_correction(
    how: RunOptions, options: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    with (
        LiveRun(SCENARIO, path, how, held=True) as run,
        visitor(run, *options) as process,
    ):
        run.begin_with("visitor")
        assert run.await_end() == 0
        said, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0
    assert "correction applied" in said
    assert said.endswith("ended: finished\n")

    reports = [r for r in messages(path, keys.REPORT, SourceReport) if r.carrier == "visitor"]
    steps = list(messages(path, keys.CLOSED_FUSION, Closed))
    closed_at = {step.t_ns: step.step for step in steps}
    answers = [closed_at[report.t_ns] if "--answer-steps" in options else 0 for report in reports]
    assert [report.step for report in reports] == answers
    assert len(reports) >= STEPS - 10  # it may join a moment late
    assert "visitor" in chain.from_iterable(step.joined for step in steps)
    assert not [step for step in steps if step.gave_up or step.late or step.lost]

    nees = nees_of_visitor(path)
    assert len(nees) >= STEPS / 2
    assert max(nees) < NEES_LIMIT
    if "--use-corrections" in options:
        assert_right_once_corrected(path)
    with open_recording(path) as recording:
        assert recording.end is not None
        assert recording.end.gaps == 0
    assert outputs(path) == refused(path)


def test_a_visitor_that_dies_is_named_lost_and_its_errors_stay_unknown(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LiveRun(SCENARIO, path, SLOW) as run, visitor(run) as process:
        run.await_news("visitor has come")
        run.await_step(20)
        process.kill()
        health = run.await_news("visitor is lost")
        assert run.await_end() == 0
    assert health.lost == ["visitor"]
    steps = messages(path, keys.CLOSED_FUSION, Closed)
    assert [step.lost for step in steps if step.lost] == [["visitor"]]
    last = {c.carrier: c for c in messages(path, keys.CORRECTION, Correction)}["visitor"]
    assert (last.state, last.reason) == ("suspended", "visitor is lost")
    rows = {row.carrier: row for row in frame_summaries(path)}
    assert isnan(rows["visitor"].after_m)
    assert rows["bravo"].after_m < rows["bravo"].before_m
    assert outputs(path) == refused(path)


def test_datagrams_of_json_get_a_right_correction_and_rubbish_among_them_is_counted(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.mcap"
    with LiveRun(SCENARIO, path, RunOptions(rate="10"), held=True) as run, free_port() as port:
        address = f"127.0.0.1:{port}"
        udp = socket.socket(type=socket.SOCK_DGRAM)

        def tell(line: bytes) -> None:
            for datagram in (line, b"\x00\xffrubbish", b'{"bearing_deg": 1, "range_m": "far"}'):
                udp.sendto(datagram, ("127.0.0.1", port))

        options = [*bridge_options(run), "--use-corrections"]
        with started("-m", "crossfix", "bridge", "jsonl", "--udp", address, *options) as bridge:
            await_line(bridge, "takes part")
            with udp, seen(run, tell):
                run.begin_with("visitor")
                run.await_step(30)
                counters = status(run)
                assert run.await_end() == 0
                said, _ = bridge.communicate(timeout=DEADLINE_S)
    assert bridge.returncode == 0
    assert "the run has ended" in said
    assert counters["received"] >= 60
    assert counters["rejected line"] + counters["rejected range_m"] == counters["rejected"]
    assert abs(counters["decoded"] - counters["rejected line"]) <= 1
    nees = nees_of_visitor(path)
    assert len(nees) >= STEPS / 2
    assert max(nees) < NEES_LIMIT
    assert_right_once_corrected(path)
    assert outputs(path) == refused(path)


@pytest.mark.slow
def test_a_connection_that_dies_in_mid_line_costs_that_line(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    paced = RunOptions(rate="10")
    with LiveRun(SCENARIO, path, paced, held=True) as run, FaultyServer() as server:
        told: list[bytes] = []

        def tell(line: bytes) -> None:
            told.append(line)
            if len(told) % 10:
                server.tell(line)
            else:
                server.die_in_the_middle_of(line)

        where = ["--tcp", server.address, *bridge_options(run)]
        with started("-m", "crossfix", "bridge", "jsonl", *where) as bridge:
            await_line(bridge, "takes part")
            with seen(run, tell):
                run.begin_with("visitor")
                assert run.await_end() == 0
            said, _ = bridge.communicate(timeout=DEADLINE_S)
    assert len(told) >= STEPS / 2
    deaths = len(told) // 10
    assert f"rejected {deaths} (line: {deaths})" in said
    reports = [r for r in messages(path, keys.REPORT, SourceReport) if r.carrier == "visitor"]
    assert len(told) - deaths - 1 <= len(reports) <= len(told) - deaths
    assert max(nees_of_visitor(path)) < NEES_LIMIT


def test_a_run_comes_out_as_lines(tmp_path: Path) -> None:
    with LiveRun(SCENARIO, tmp_path / "run.mcap", SLOW) as run:
        where = ["--run", run.run, "--connect", run.endpoint]
        topics = ["--topic", "correction", "--topic", "report"]
        with started("-m", "crossfix", "bridge", "jsonl", "--out", *where, *topics) as printing:
            await_line(printing, "listening")
            assert run.await_end() == 0
            out, _ = printing.communicate(timeout=DEADLINE_S)
    assert printing.returncode == 0
    lines = [json.loads(line) for line in out.splitlines()]
    applied = [line["step"] for line in lines if line.get("state") == "applied"]
    assert applied == list(range(applied[0], STEPS + 1))
    for carrier in ("alpha", "bravo"):
        reports = [line for line in lines if line["topic"] == "report"]
        seqs = [report["seq"] for report in reports if report["carrier"] == carrier]
        assert seqs == list(range(seqs[0], STEPS + 1))
    assert {line["topic"] for line in lines} == {"correction", "report"}


def test_whoever_reads_the_lines_may_stop(tmp_path: Path) -> None:
    with LiveRun(SCENARIO, tmp_path / "run.mcap", SLOW) as run:
        where = ["--run", run.run, "--connect", run.endpoint]
        bridge = [sys.executable, "-m", "crossfix", "bridge", "jsonl", "--out", *where]
        with subprocess.Popen(bridge, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as printing:
            assert printing.stdout is not None
            assert printing.stderr is not None
            assert b"topic" in printing.stdout.readline()
            printing.stdout.close()
            assert printing.wait(DEADLINE_S) == 0
            assert b"Error" not in printing.stderr.read()
        counted = subprocess.run(
            [*bridge, "--count", "3"], check=True, capture_output=True, timeout=DEADLINE_S
        )
        assert len(counted.stdout.splitlines()) == 3


def status(run: LiveRun) -> dict[str, int]:
    """What the bridge has counted, by the command that asks it."""
    where = ["--run", run.run, "--connect", run.endpoint]
    with started("-m", "crossfix", "bridge", "status", "visitor", *where) as asking:
        out, _ = asking.communicate(timeout=DEADLINE_S)
    assert asking.returncode == 0
    counters: dict[str, int] = json.loads(out)
    return counters


@contextmanager
def free_port() -> Iterator[int]:
    """A UDP port that nobody listens on."""
    with socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    yield port
