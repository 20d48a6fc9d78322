"""The doctor: well here, and of every ill it says what to do."""

from __future__ import annotations

import json
import re
import resource
import socket
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from crossfix.commands.doctor import BAD
from crossfix.doctor import Finding, installation, machine, rehearsal, wire, worst
from crossfix.doctor.finding import judged
from crossfix.doctor.installation import Requirement
from crossfix.doctor.machine import Clocks
from schemas import keys
from schemas.bus.zenoh_bus import open_bus
from schemas.errors import BusError, CrossfixError
from tests.crossfix.conftest import Crossfix
from tests.promptness import prompt, within

DEAD = "tcp/127.0.0.1:1"
MAIN = {
    "python",
    "crossfix",
    "numpy",
    "eclipse-zenoh",
    "shared memory",
    "open files",
    "disk space",
    "disk speed",
    "round trip",
    "rehearsal",
    "clock step",
    "clock is set",
    "clock jumps",
}


# the whole


@pytest.mark.live
def test_all_is_well_here(crossfix: Crossfix, hub: str, tmp_path: Path) -> None:
    shown = crossfix("doctor", "--connect", hub, "--recordings", tmp_path / "new", "--json")
    told = json.loads(shown.out)
    findings = {finding["what"]: finding for finding in told["findings"]}
    bad = [finding for finding in told["findings"] if finding["verdict"] == "bad"]
    assert (shown.code, bad) == (0, [])
    assert set(findings) >= MAIN
    assert findings["rehearsal"]["frames"]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.live
def test_it_starts_a_hub_of_its_own_and_shows_a_line_a_check(
    crossfix: Crossfix, tmp_path: Path
) -> None:
    shown = crossfix("doctor", "--recordings", tmp_path)
    assert shown.code == 0
    quick_or_slow = "(ok  |warn)"  # as the machine has it
    assert re.search(rf"^{quick_or_slow} round trip      p50 ", shown.out, re.MULTILINE)
    assert re.search(rf"^{quick_or_slow} rehearsal  ", shown.out, re.MULTILINE)
    assert "Error of each carrier's frame" in shown.out


def test_what_is_bad_comes_with_what_to_do_and_an_exit_code(
    crossfix: Crossfix, tmp_path: Path
) -> None:
    shown = crossfix("doctor", "--connect", DEAD, "--recordings", tmp_path)
    assert shown.code == BAD
    lines = shown.out.splitlines()
    (number,) = [n for n, line in enumerate(lines) if line.startswith("bad ")]
    assert lines[number] == f"bad  round trip      no hub answers at {DEAD}"
    assert f"do: start one: crossfix hub --listen {DEAD}" in lines[number + 1]
    assert "rehearsal" not in shown.out  # it could only fail for the same reason


def test_an_endpoint_that_is_none_is_an_error_of_the_user(
    crossfix: Crossfix, tmp_path: Path
) -> None:
    shown = crossfix("doctor", "--connect", "nowhere", "--recordings", tmp_path)
    assert shown.code == CrossfixError.exit_code
    assert "not an endpoint; got 'nowhere'" in shown.err


def test_the_verdict_on_all_is_the_worst_one() -> None:
    ok, warn, bad = (Finding("", verdict, "") for verdict in ("ok", "warn", "bad"))
    assert worst([]) == "ok"
    assert worst([ok, warn, ok]) == "warn"
    assert worst([bad, warn]) == "bad"


@pytest.mark.parametrize(("value", "verdict"), [(10, "ok"), (9, "warn"), (2, "warn"), (1, "bad")])
def test_more_is_better(value: float, verdict: str) -> None:
    found = judged("what", value, "found", "advice", warn_below=10, bad_below=2)
    assert found.verdict == verdict
    assert found.advice == ("" if verdict == "ok" else "advice")


# versions


@pytest.mark.parametrize(
    ("found", "wanted", "within"),
    [
        ("2.0", ">=2.0", True),
        ("2", ">=2.0", True),
        ("1.26.4", ">=2.0", False),
        ("1.9", ">=1.10,<2", False),
        ("1.10.2", ">=1.10,<2", True),
        ("2.0.0", ">=1.10, <2", False),
        ("3.11.7", ">=3.11", True),
        ("3.10.12", ">=3.11", False),
        ("2.1rc1", "!=2.1", False),
        ("1.0", "", True),
        ("1.0", "~=0.9", True),
    ],
)
def test_versions_in_ranges(found: str, wanted: str, within: bool) -> None:
    assert installation.is_within(found, wanted) is within


def test_a_package_that_is_missing_or_old() -> None:
    wanted = Requirement("numpy", ">=2.0")
    assert installation.dependency(wanted, "2.1").verdict == "ok"
    for found in (None, "1.26"):
        finding = installation.dependency(wanted, found)
        assert finding.verdict == "bad"
        assert finding.advice == "python -m pip install --upgrade 'numpy>=2.0'"
    assert "1.26, not >=2.0" in installation.dependency(wanted, "1.26").found


def test_a_package_of_an_extra_may_be_missing_but_not_old() -> None:
    wanted = Requirement("bokeh", ">=3.6", "view")
    assert installation.dependency(wanted, None).verdict == "ok"
    assert "crossfix[view]" in installation.dependency(wanted, None).found
    assert installation.dependency(wanted, "3.1").verdict == "bad"


def test_a_python_that_is_too_old() -> None:
    assert installation.python("3.11.2", ">=3.11").verdict == "ok"
    assert installation.python("3.10.2", ">=3.11").verdict == "bad"


def test_what_is_asked_for_is_what_the_project_says() -> None:
    wanted = installation.wanted_here()
    asked = {requirement.package: requirement for requirement in wanted.requirements}
    assert asked["mcap"].versions.startswith(">=1.6")
    assert asked["bokeh"].extra == "view"
    assert asked["numpy"].extra == ""
    assert wanted.python == ">=3.11"


def test_requirements_as_an_installed_package_says_them() -> None:
    texts = ("numpy>=2.0", "mcap<2,>=1.6", "bokeh>=3.6; extra == 'view'", "x[y]==1 ; extra=='z'")
    assert installation._requirements(texts) == (
        Requirement("numpy", ">=2.0"),
        Requirement("mcap", "<2,>=1.6"),
        Requirement("bokeh", ">=3.6", "view"),
        Requirement("x", "==1", "z"),
    )


# the machine


def test_a_disk_that_cannot_be_written(tmp_path: Path) -> None:
    *_, speed = machine.disk(Path("/proc"))
    assert speed.verdict == "bad"
    assert "writable" in speed.advice
    space, speed = machine.disk(tmp_path / "not" / "there" / "yet")
    assert str(tmp_path) in space.found
    assert speed.verdict != "bad"


@pytest.mark.parametrize(("free_mb", "verdict"), [(2000, "ok"), (500, "warn"), (10, "bad")])
def test_a_full_disk(
    free_mb: int, verdict: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Usage:
        free = free_mb * 10**6

    monkeypatch.setattr("shutil.disk_usage", lambda _: Usage)
    space = next(machine.disk(tmp_path))
    assert space.verdict == verdict
    assert bool(space.advice) is (verdict != "ok")


@pytest.mark.parametrize(
    ("limit", "verdict"),
    [(resource.RLIM_INFINITY, "ok"), (4096, "ok"), (256, "warn"), (32, "bad")],
)
def test_a_limit_of_open_files(limit: int, verdict: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("resource.getrlimit", lambda _: (limit, limit))
    assert machine.open_files().verdict == verdict


def test_shared_memory_may_be_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert machine.shared_memory().verdict == "ok"
    monkeypatch.setattr(machine, "SHARED", Path("/nowhere"))
    assert machine.shared_memory() == Finding("shared memory", "ok", "none; not needed")


@pytest.mark.parametrize(("tick_ns", "verdict"), [(100, "ok"), (15_625_000, "warn")])
def test_a_coarse_clock(tick_ns: int, verdict: str, monkeypatch: pytest.MonkeyPatch) -> None:
    readings = Counter({"now": 0})

    def coarse() -> int:
        readings["now"] += 20_000 if tick_ns > 20_000 else tick_ns
        return readings["now"] // tick_ns * tick_ns

    monkeypatch.setattr("time.time_ns", coarse)
    assert machine.resolution().verdict == verdict


@pytest.mark.parametrize(("jump_s", "verdict"), [(0.0, "ok"), (-0.5, "warn"), (3600.0, "bad")])
def test_a_clock_that_was_set_meanwhile(jump_s: float, verdict: str) -> None:
    now = Clocks.read()
    before = Clocks(now.wall_s - 10.0 - jump_s, now.monotonic_s - 10.0)
    found = machine.steps(before)
    assert found.verdict == verdict
    assert float(found.found.split()[0]) == pytest.approx(jump_s * 1000, abs=5)  # of a slow test


def test_it_is_known_or_said_to_be_unknown_whether_the_clock_is_set() -> None:
    found = machine.synchronised()
    assert found.verdict in ("ok", "warn")
    assert found.found


# the wire


@pytest.fixture
def listening() -> Iterator[int]:
    """A port where something listens that is no hub."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        yield taken.getsockname()[1]


def test_a_port_that_is_free_taken_or_a_hubs(hub: str, listening: int) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        number = free.getsockname()[1]
    assert wire.port(number) == Finding(f"port {number}", "ok", "free")
    taken = wire.port(listening)
    assert taken.verdict == "warn"
    assert "no hub" in taken.found
    assert f"--listen tcp/127.0.0.1:{listening + 1}" in taken.advice
    ours = wire.port(int(hub.rpartition(":")[2]))
    assert ours.verdict == "ok"
    assert ours.found.startswith("a hub listens (pid ")
    assert "tests.hub_process" in ours.found or "schemas.bus.hub" in ours.found


def test_the_round_trip_and_who_is_there(hub: str) -> None:
    with open_bus(hub) as bus, bus.announce(keys.alive("harbour", "world", "b1")):
        found = wire.round_trip(hub)
    assert found.verdict in ("ok", "warn")
    assert found.found.startswith("p50 ")
    assert "run harbour: world" in found.found


def test_a_round_trip_to_nowhere() -> None:
    with pytest.raises(BusError, match="not an endpoint"):
        wire.round_trip("nowhere")
    assert wire.round_trip(DEAD).verdict == "bad"


# the rehearsal


@pytest.mark.live
def test_a_rehearsal_that_corrects_nothing_is_bad(hub: str, tmp_path: Path) -> None:
    """Two seconds are too short for a correction."""
    short = tmp_path / "short.toml"
    text = rehearsal.SCENARIO.read_text().replace("duration_s = 40", "duration_s = 2")
    short.write_text(text)
    found = rehearsal.rehearse(hub, short)
    assert found.verdict == "bad"
    assert "no correction was applied" in found.found


@prompt
@pytest.mark.live
def test_a_rehearsal_that_fails_or_hangs_is_told_and_ended(hub: str, tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("name = 'wrong'")
    with within(15.0):
        late = rehearsal.rehearse(hub, deadline_s=0.05)
        assert late.verdict == "bad"
        assert "not done in 0.05 s" in late.found
        assert rehearsal.rehearse(hub, wrong).verdict == "bad"
    with open_bus(hub) as bus:
        assert not [token for token in bus.tokens(keys.every_alive("*")) if "doctor-" in token]
