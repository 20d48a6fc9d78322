"""`check`: exit codes, tables and JSON, from a recording and from a live publisher."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from schemas import keys
from schemas.bus.zenoh_bus import open_bus
from schemas.messages import DeclaredScenario, Origin
from schemas.qos import DATA
from schemas.recording.contents import RunEnd, RunHeader, run_attachments
from schemas.recording.writer import RecordingWriter
from tests.crossfix.conftest import Crossfix
from tests.schemas.conformance.publishers import (
    EPOCH_NS,
    RUN,
    SECOND,
    STEPS,
    Publisher,
    as_sample,
    in_reports,
)

SCENARIO = DeclaredScenario(
    name=RUN, origin=Origin(latitude_rad=0.63, longitude_rad=-0.096), epoch_ns=EPOCH_NS,
    step_ns=SECOND, steps=STEPS, carriers=[],
)  # fmt: skip
DEGREES = in_reports(
    lambda m: {**m, "bearing_rad": [math.degrees(bearing) for bearing in m["bearing_rad"]]}
)
SURE = in_reports(lambda m: {**m, "sigma_range_m": [5.0] * len(m["range_m"])})


def recorded(path: Path, publisher: Publisher, end: RunEnd | None = None) -> Path:
    header = RunHeader(run=RUN, scenario=RUN)
    with RecordingWriter(path, header, attachments=run_attachments(SCENARIO)) as writer:
        for sample, arrived_s in publisher.samples():
            log_time_ns = round(arrived_s * 1e9)
            writer.write(*sample, log_time_ns=log_time_ns, publish_time_ns=log_time_ns, sequence=0)
        if end:
            writer.close(end)
    return path


def test_a_clean_recording_is_clean(tmp_path: Path, crossfix: Crossfix) -> None:
    shown = crossfix("check", "--recording", recorded(tmp_path / "r.mcap", Publisher()), "--json")
    assert shown.code == 0
    facts = json.loads(shown.out)
    assert facts["findings"] == []
    assert facts["heard"] == {
        "visitor/info": 1, "visitor/navigation": STEPS, "visitor/radar": STEPS,
    }  # fmt: skip
    assert [check["verdict"] for check in facts["sigmas"]] == ["consistent", "consistent"]


def test_errors_are_shown_with_what_to_do(
    tmp_path: Path, crossfix: Crossfix, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    shown = crossfix("check", "--recording", recorded(tmp_path / "r.mcap", Publisher(broken=SURE)))
    assert shown.code == 1
    text = " ".join(shown.out.split())
    assert "visitor/radar" in text
    assert "sigma_too_small" in text
    assert "Claim larger sigmas" in text
    assert "1 error, 0 warnings" in text
    assert max(map(len, shown.out.splitlines())) <= 80


def test_what_a_recorder_refused_is_told(tmp_path: Path, crossfix: Crossfix) -> None:
    end = RunEnd(reason="finished", rejected=3, rejections={"visitor/radar": "3, the last: NaN"})
    path = recorded(tmp_path / "r.mcap", Publisher(), end)
    shown = crossfix("check", "--recording", path, "--json")
    assert shown.code == 1
    (finding,) = json.loads(shown.out)["findings"]
    assert (finding["code"], finding["example"]) == ("refused", "3, the last: NaN")
    assert crossfix("check", "--recording", path, "--carrier", "other").code == 2
    assert "3, the last: NaN" in crossfix("info", path).out


def test_nothing_asked_is_explained(crossfix: Crossfix) -> None:
    shown = crossfix("check")
    assert shown.code == 2
    assert "--run NAME or --recording FILE" in shown.err


@contextmanager
def publishing(endpoint: str, publisher: Publisher, token: bool) -> Iterator[None]:
    """A stranger without backfill that says ten seconds in every second."""
    over, steps = threading.Event(), iter(range(1, 10_000))

    def work() -> None:
        while not over.wait(0.1):
            for sent in publisher.step(next(steps)):
                bus.publish(*as_sample(sent), DATA)

    with open_bus(endpoint) as bus:
        thread = threading.Thread(target=work)
        if token:
            held = bus.announce(keys.alive(RUN, "visitor", publisher.boot))
            with held:
                thread.start()
                yield
        else:
            thread.start()
            yield
        over.set()
        thread.join()


@pytest.mark.live
@pytest.mark.timeout(60)
@pytest.mark.parametrize("token", [True, False])
def test_a_live_publisher_is_diagnosed(hub: str, crossfix: Crossfix, token: bool) -> None:
    with publishing(hub, Publisher(broken=DEGREES), token):
        where = ("--run", RUN, "--connect", hub, "--carrier", "visitor")
        shown = crossfix("check", *where, "--seconds", "3", "--json")
    assert shown.code == 1
    found = {finding["code"] for finding in json.loads(shown.out)["findings"]}
    # It is met midway, so its SourceInfo was not heard, and nobody answers for it.
    unanswered = {"backfill", "degrees"}
    assert found - {"source_unheard", "latched"} == unanswered | (set() if token else {"token"})


@pytest.mark.live
@pytest.mark.timeout(60)
def test_silence_is_no_success(hub: str, crossfix: Crossfix) -> None:
    shown = crossfix("check", "--run", "nobody", "--connect", hub, "--seconds", "0.2")
    assert shown.code == 2
    assert "nothing was heard" in shown.out
