"""Whatever a user gets wrong is told in one line that says what to do, and nothing is started."""

from __future__ import annotations

import shlex
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from crossfix.__main__ import BAD_USE, VERBS
from schemas.bus.zenoh_bus import ZenohBus
from tests.crossfix.conftest import Crossfix, Outcome, started
from tests.crossfix.small_recording import record
from tests.project.tree import ROOT

MOST_CHARACTERS = 400
"""Two or three lines of a terminal."""
PATIENCE_S = 0.3
DEAD = "tcp/127.0.0.1:1"
STRAIT = str(ROOT / "scenarios" / "strait.toml")


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with files that are not what their names say."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("CROSSFIX_DATA", raising=False)
    Path("empty").touch()
    Path("noise").write_bytes(bytes(range(256)) * 16)
    Path("folder").mkdir()
    return tmp_path


@pytest.fixture
def refused(
    crossfix: Crossfix, place: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Outcome]:
    """Run a command line that must fail as it should, without any process started."""

    def fail(*_: object, **__: object) -> None:
        raise AssertionError("a process was started")

    def impatient(endpoint: str, timeout_s: float) -> ZenohBus:
        return ZenohBus(endpoint, min(timeout_s, PATIENCE_S))

    for name in ("crossfix.children.spawn", "crossfix.launch.spawn", "os.execve"):
        monkeypatch.setattr(name, fail)
    monkeypatch.setattr("schemas.bus.zenoh_bus.ZenohBus", impatient)

    def run(*arguments: object) -> Outcome:
        before = sorted(path.name for path in place.rglob("*.mcap"))
        shown = crossfix(*arguments)
        *_, line = shown.err.splitlines()
        assert shown.code == BAD_USE
        assert line.startswith("error: ")
        assert len(line) <= MOST_CHARACTERS
        assert "Traceback" not in shown.err
        assert ".rs:" not in shown.err, "the insides of a library"
        assert sorted(path.name for path in place.rglob("*.mcap")) == before
        return shown

    return run


@contextmanager
def taken_port() -> Iterator[str]:
    """An endpoint where something listens that is no hub."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        yield f"tcp/127.0.0.1:{listening.getsockname()[1]}"


# the command line itself


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("unheard-of", 'Unknown command "unheard-of"'),
        ("hub --lisen x", "Did you mean --listen?"),
        ("run", "SCENARIO requires an argument"),
        ("carrier levante", "--run requires an argument"),
        ("run a.toml b.toml", "b.toml"),
        ("run a.toml --rate fast", "Expected max or a number above 0"),
        ("run a.toml --rate 0", "Expected max or a number above 0"),
        ("replay a.mcap --rate=-1", "Expected max or a number above 0"),
        ("replay a.mcap --role nothing", '"input", "truth"'),
        ("run a.toml --seed x", "int"),
        ("run a.toml --step-timeout=-1", "Expected a number above 0"),
        ("run a.toml --max-loss nan", "Expected a number, 0 or above"),
        ("run a.toml --name 'A b'", "Expected [a-z0-9_-], 1 to 32 of them"),
        ("carrier Levante --run strait", "Expected [a-z0-9_-]"),
        ("fusion --run ../strait", "Expected [a-z0-9_-]"),
        ("check --run strait --seconds 0", "Expected a number above 0"),
        ("check --run 'a b'", "Expected [a-z0-9_-]"),
        ("peek --count 0", "Expected a number above 0"),
        ("bridge jsonl - --period 0", "Expected a number above 0"),
        ("bridge jsonl - --sigma-range=-3", "Expected a number above 0"),
        ("bridge jsonl - --stamp never", '"line", "arrival"'),
        ("bridge jsonl - --kind 'A b'", "Expected [a-z0-9_-]"),
    ],
)
def test_an_option_that_means_nothing(
    line: str, told: str, refused: Callable[..., Outcome]
) -> None:
    shown = refused(*shlex.split(line))
    assert told in shown.err
    verb = line.split(maxsplit=1)[0]
    assert f"See `crossfix {f'{verb} ' if verb in VERBS else ''}" in shown.err
    assert "--help`" in shown.err


# files


@pytest.mark.parametrize("verb", ["info", "verify", "report", "replay", "check --recording"])
@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("missing", "No such file or directory"),
        ("empty", "empty file"),
        ("noise", "not an MCAP file"),
        ("folder", "Is a directory"),
    ],
)
def test_a_file_that_is_no_recording(
    verb: str, name: str, told: str, refused: Callable[..., Outcome]
) -> None:
    shown = refused(*verb.split(), name)
    assert f"error: {name}: " in shown.err
    assert told in shown.err
    assert "expected a recording, such as `crossfix run` leaves" in shown.err


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("missing", "No such file or directory"),
        ("folder", "Is a directory"),
        ("noise", "not a text file"),
    ],
)
def test_a_file_that_is_no_scenario(name: str, told: str, refused: Callable[..., Outcome]) -> None:
    shown = refused("run", name)
    assert f"error: {name}: " in shown.err
    assert told in shown.err
    assert "expected a scenario file" in shown.err


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("hello", ("not TOML", "Expected '='")),
        ("name = 'x'", ("time", "missing")),
        ("colour = 'red'", ("colour: unknown key", "expected one of ")),
    ],
)
def test_a_scenario_that_is_none(
    text: str, told: tuple[str, ...], refused: Callable[..., Outcome]
) -> None:
    Path("own.toml").write_text(text)
    shown = refused("run", "own.toml")
    assert "error: own.toml: " in shown.err
    assert all(words in shown.err for words in told)


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ("foo", ("not an override", "expected key=value")),
        ("foo=1", ("foo: unknown key", "expected one of ")),
        ("seed=-1", ("seed: wrong value", "int >= 0")),
        ("time.duration_s=0", ("time.duration_s",)),
        ("origin.latitude_deg=95", ("origin.latitude_deg",)),
        ("carriers.0.name='A b'", ("name",)),
        ("fusion.gate=1", ("gate: no such setting", "expected such as ")),
        ("fusion.registration.method=1", ("registration.method",)),
        ("fusion.own='nobody'", ("own", "nobody", "levante")),
    ],
)
def test_a_bad_override(
    override: str, told: tuple[str, ...], refused: Callable[..., Outcome]
) -> None:
    shown = refused("run", STRAIT, "--set", override)
    assert all(words in shown.err for words in told)


def test_recorded_tracks_that_are_not_there(refused: Callable[..., Outcome]) -> None:
    shown = refused("run", ROOT / "scenarios" / "solent.toml", "--data", "folder")
    assert "name its folder by --data DIR or CROSSFIX_DATA" in shown.err


@pytest.mark.parametrize(
    ("output", "told"),
    [
        ("empty", ("exists already", "expected the name of a new file")),
        ("folder", ("exists already",)),
        ("nowhere/x.mcap", ("no such folder", "mkdir it first")),
        ("/proc/x.mcap", ("no file can be written there", "--output elsewhere")),
    ],
)
@pytest.mark.parametrize("verb", [f"run {STRAIT}", "fusion --run strait"])
def test_an_output_that_cannot_be_written(
    verb: str, output: str, told: tuple[str, ...], refused: Callable[..., Outcome]
) -> None:
    shown = refused(*verb.split(), "--output", output)
    assert f"error: {output}: " in shown.err
    assert all(words in shown.err for words in told)


def test_a_report_that_cannot_be_written(refused: Callable[..., Outcome]) -> None:
    record(Path("run.mcap"))
    for output, advice in (("folder", "--output elsewhere"), ("nowhere/x.html", "mkdir it first")):
        assert f"expected {advice}" in refused("report", "run.mcap", "-o", output).err
    assert "would overwrite its recording" in refused("report", "run.mcap", "-o", "run.mcap").err


# hubs


@pytest.mark.parametrize(
    "line",
    [
        f"run {STRAIT}",
        "check --run strait",
        "peek",
        "replay run.mcap",
        "bridge jsonl empty --run strait --start-timeout 1",
        "bridge jsonl --out --run strait",
        "bridge status harbour --run strait",
    ],
)
def test_an_endpoint_that_is_none_and_a_hub_that_is_not_there(
    line: str, place: Path, refused: Callable[..., Outcome]
) -> None:
    record(place / "run.mcap")
    shown = refused(*line.split(), "--connect", "nowhere")
    assert "not an endpoint; got 'nowhere'; expected tcp/HOST:PORT" in shown.err
    shown = refused(*line.split(), "--connect", DEAD)
    assert f"no hub at {DEAD}; start one with `crossfix hub` or pass --connect" in shown.err


def test_what_listens_there_is_no_hub(refused: Callable[..., Outcome]) -> None:
    with taken_port() as endpoint:
        assert f"no hub at {endpoint}" in refused("peek", "--connect", endpoint).err


@pytest.mark.parametrize("verb", ["world", "carrier", "fusion"])
def test_a_process_started_by_hand_without_a_hub(verb: str, place: Path) -> None:
    """These become another program, so they are tried as one."""
    given = {"world": [STRAIT], "carrier": ["levante", "--run", "strait"]}
    arguments = given.get(verb, ["--run", "strait", "--output", str(place / "x.mcap")])
    with started(verb, *arguments, "--connect", DEAD, "--start-timeout", "1") as process:
        _, told = process.communicate(timeout=30)
        assert process.returncode == BAD_USE
    assert told.splitlines()[-1] == (
        f"error: no hub at {DEAD}; start one with `crossfix hub` or pass --connect"
    )
    assert not (place / "x.mcap").exists()


def test_a_port_in_use(refused: Callable[..., Outcome]) -> None:
    with taken_port() as endpoint:
        shown = refused("hub", "--listen", endpoint)
    assert f"{endpoint} is taken; end the hub that runs there, or pass --listen" in shown.err


@pytest.mark.parametrize(
    ("listen", "reason"),
    [
        ("nowhere", "not an endpoint"),
        ("tcp/127.0.0.1:99999", "not an endpoint"),
        ("tcp/192.0.2.1:7447", "Cannot assign requested address"),
    ],
)
def test_a_hub_that_cannot_listen_there(
    listen: str, reason: str, refused: Callable[..., Outcome]
) -> None:
    shown = refused("hub", "--listen", listen)
    assert f"error: {listen}: cannot listen there; got '{reason}" in shown.err
    assert "expected tcp/ADDRESS:PORT of this machine" in shown.err


@pytest.mark.parametrize(
    ("key", "run"), [("a b//", "*"), ("report/***", "*"), ("report/**", "A b")]
)
def test_a_key_expression_that_is_none(
    key: str, run: str, hub: str, refused: Callable[..., Outcome]
) -> None:
    refused("peek", key, "--run", run, "--connect", hub)


def test_a_run_that_is_not_there(hub: str, refused: Callable[..., Outcome]) -> None:
    line = ["--run", "nobodys", "--connect", hub]
    assert "nobody" in refused("bridge", "status", "harbour", *line).err
    shown = refused("bridge", "jsonl", "empty", *line, "--start-timeout", "1")
    assert "expected a world that runs `nobodys` on the same hub" in shown.err


@pytest.mark.live
def test_a_carrier_that_the_scenario_does_not_have(hub: str) -> None:
    joining = ["--connect", hub, "--run", "short-of-one"]
    with (
        started("world", STRAIT, *joining, "--start-timeout", "30"),
        started("carrier", "nobody", *joining, "--start-timeout", "30") as carrier,
    ):
        _, told = carrier.communicate(timeout=60)
        assert carrier.returncode == BAD_USE
    assert told == (
        "error: strait: no such carrier; got 'nobody'; expected one of levante, poniente, siroco\n"
    )


def test_nothing_heard_is_told(hub: str, crossfix: Crossfix) -> None:
    shown = crossfix("check", "--run", "nobodys", "--connect", hub, "--seconds", "0.5")
    assert shown.code == BAD_USE
    assert "is the run's name right, and does the carrier publish?" in shown.out


# bridges


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ("jsonl", "--run NAME, or --dry-run"),
        ("jsonl missing --dry-run", "expected a file, or - for stdin"),
        ("jsonl folder --dry-run", "folder: Is a directory; expected a file"),
        ("jsonl empty --udp 127.0.0.1:5 --dry-run", "records from two places"),
        ("jsonl --udp nowhere --dry-run", "not an address; got 'nowhere'; expected HOST:PORT"),
        ("jsonl --listen 192.0.2.1:80 --dry-run", "expected a free port of this machine"),
        ("jsonl empty --dry-run --position x", "expected LAT,LON"),
        ("jsonl empty --dry-run --position 99,0", "expected LAT,LON"),
        ("jsonl empty --dry-run --position nan,0", "expected LAT,LON"),
        ("jsonl empty --dry-run --as harbour", "expected carrier=NAME,source=NAME"),
        ("jsonl empty --dry-run --as carrier=World!", "expected [a-z0-9_-]"),
        ("jsonl --out --run strait --topic noise", "no such topic; got 'noise'; expected"),
    ],
)
def test_a_bridge_that_cannot_be(options: str, told: str, refused: Callable[..., Outcome]) -> None:
    assert told in refused("bridge", *options.split()).err
