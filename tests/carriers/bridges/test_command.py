"""`crossfix bridge`: what a user sees of it without a run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from crossfix.commands.bridge import bridge
from tests.crossfix.conftest import Crossfix, crossfix

__all__ = ["crossfix"]

LINES = """\
{"source": "radar", "t_s": 1767225601.5, "bearing_deg": [41.2, 97], "range_m": [5300, 8120.5]}
{"bearing_deg": 41, "rnage_m": 3}
rubbish
{"topic": "navigation", "pose": {"latitude_deg": 36, "longitude_deg": -5}}
"""


@pytest.fixture
def lines(tmp_path: Path) -> Path:
    path = tmp_path / "plots.jsonl"
    path.write_text(LINES)
    return path


def test_a_dry_run_shows_what_would_be_published_and_what_is_wrong(
    lines: Path, crossfix: Crossfix, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    names = "carrier=harbour,source=ais"
    shown = crossfix("bridge", "jsonl", lines, "--dry-run", "--as", names, "--sigma-range", "40")
    assert shown.code == 1  # a line is refused
    printed = [json.loads(line) for line in shown.out.splitlines()]
    assert [line["key"].removeprefix("crossfix/@v1/dry-run/") for line in printed] == [
        "source/harbour/radar",
        "report/harbour/radar",
        "navigation/harbour",
    ]
    assert printed[0]["message"]["properties"] == {"period_s": 1.0, "sigma_range_m": 40.0}
    assert printed[1]["message"]["t_ns"] == 1767225601500000000
    assert printed[2]["message"]["pose"]["covariance"][0] == 100.0**2
    assert "refused a record: rnage_m: no such field; expected range_m" in caplog.text
    assert "received 4, decoded 2, rejected 2" in caplog.text


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--udp", "1:2"], "records from two places"),
        (["--position", "north"], "LAT,LON"),
        (["--position", "36,-5,1,2"], "LAT,LON"),
        (["--position", "96,-5"], "expected LAT,LON"),
        (["--period", "0"], "Expected a number above 0"),
        (["--sigma-position", "0"], "Expected a number above 0"),
        (["--as", "name=x"], "carrier=NAME,source=NAME"),
        (["--as", "carrier=Harbour"], "[a-z0-9_-]"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(
    options: list[str], words: str, lines: Path, crossfix: Crossfix
) -> None:
    shown = crossfix("bridge", "jsonl", lines, "--dry-run", *options)
    assert shown.code == 2
    assert shown.out == ""
    assert shown.err.startswith("error: ")
    assert words in shown.err


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (["jsonl", "none.jsonl", "--dry-run"], "No such file"),
        (["jsonl", "--nonsense", "--dry-run"], "no such option"),
        (["jsonl", "-"], "--run NAME"),
        (["jsonl", "--out"], "--run NAME"),
        (["jsonl", "--udp", "there", "--run", "r"], "HOST:PORT"),
        (["jsonl", "--udp", "192.0.2.1:9", "--run", "r"], "cannot listen"),
        (["jsonl", "--out", "--run", "r", "--connect", "tcp/127.0.0.1:1"], "crossfix hub"),
        (["status", "x", "--run", "r", "--connect", "tcp/127.0.0.1:1"], "crossfix hub"),
    ],
)
def test_errors_say_what_to_do(line: list[str], words: str, crossfix: Crossfix) -> None:
    shown = crossfix("bridge", *line)
    assert shown.code == 2
    assert words in shown.err


def test_without_a_kind_it_shows_what_there_is(crossfix: Crossfix) -> None:
    shown = crossfix("bridge")
    assert shown.code == 0
    assert "jsonl" in shown.out
    assert "status" in shown.out


@pytest.mark.parametrize("verb", ["jsonl", "status"])
def test_every_option_is_explained_and_an_example_shown(verb: str, crossfix: Crossfix) -> None:
    for argument in bridge[verb].assemble_argument_collection(parse_docstring=True):
        assert argument.children or argument.parameter.help, f"{verb} {argument.name}"
    shown = crossfix("bridge", verb, "--help")
    assert f" crossfix bridge {verb} " in shown.out.replace(f"Usage: crossfix bridge {verb}", "")
