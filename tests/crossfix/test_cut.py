"""`cut`: a part is a recording that stands alone, and can be fused again without the rest."""

import json
from pathlib import Path

import pytest
from msgspec.structs import replace

from schemas import codec, keys
from schemas.messages import SourceReport, StreamSpan
from schemas.recording.reader import open_recording
from tests.crossfix.conftest import Crossfix
from tests.crossfix.remade import everything, remade
from tests.crossfix.small_recording import REPORT, STEPS, record, record_torn


@pytest.fixture
def path(tmp_path: Path) -> Path:
    record(tmp_path / "small.mcap")
    return tmp_path / "small.mcap"


@pytest.fixture
def new(tmp_path: Path) -> Path:
    return tmp_path / "new.mcap"


def roles(path: Path) -> set[str]:
    return {message.address.topic.role.value for message in everything(path)}


def test_all_of_it_is_all_of_it(path: Path, new: Path, crossfix: Crossfix) -> None:
    facts = json.loads(crossfix("cut", path, "-o", new, "--json").out)
    assert (facts["left_out"], facts["restated"]) == (0, 0)
    assert everything(new) == everything(path)
    with open_recording(path) as old, open_recording(new) as made:
        assert made.attachments == old.attachments
        assert made.scenario == old.scenario


def test_a_span_of_time_comes_with_what_is_latched(
    path: Path, new: Path, crossfix: Crossfix
) -> None:
    assert crossfix("cut", path, "--start", 2, "--until", 4, "-o", new).code == 0
    old, part = everything(path), everything(new)
    start_ns = old[0].log_time_ns + 2 * 10**9
    within = [m for m in old if start_ns <= m.log_time_ns < start_ns + 2 * 10**9]
    kept = [m for m in part if m.address.topic is not keys.CLOSED_FUSION]
    assert [m for m in kept if m in within] == [
        m for m in within if m.address.topic is not keys.CLOSED_FUSION
    ]
    before = [m for m in kept if m not in within]
    assert {m.log_time_ns for m in before} == {start_ns}
    latched = {m.key for m in old if m.address.topic.latched and m.log_time_ns < start_ns}
    assert {m.key for m in before} == latched
    assert any(m.address.topic is keys.SOURCE for m in before)
    assert part[: len(before)] == before


def test_a_part_is_whole_and_can_be_fused_again(path: Path, new: Path, crossfix: Crossfix) -> None:
    crossfix("cut", path, "--start", 2, "-o", new)
    shown = crossfix("verify", new)
    assert shown.code == 0
    assert "every input that was fused is there" in shown.out
    shown = crossfix("verify", new, "--refuse")
    assert shown.code == 1
    assert "`crossfix refuse` gives it outputs of its own" in shown.out
    fused = new.with_name("fused.mcap")
    assert json.loads(crossfix("refuse", new, "-o", fused, "--json").out)["steps"] == STEPS - 2
    assert crossfix("verify", fused, "--refuse").code == 0


def test_latched_sources_of_before_are_fused_in_the_part(
    path: Path, new: Path, crossfix: Crossfix
) -> None:
    """What a source is was said before the part: its first Closed names that too."""
    crossfix("cut", path, "--start", 3, "-o", new)
    first = next(m.decode() for m in everything(new) if m.address.topic is keys.CLOSED_FUSION)
    assert {end.stream for end in first.manifest} == {"info", "navigation", "radar"}
    assert {span.stream for span in first.gave_up} == {"navigation", "radar"}
    assert all(span.first == 1 for span in first.gave_up)


def test_without_a_source_it_is_fused_as_if_there_were_none(
    path: Path, new: Path, crossfix: Crossfix
) -> None:
    shown = crossfix("cut", path, "--without", "report/b/radar", "-o", new)
    assert f"{STEPS} left out" in shown.out
    assert f"{STEPS} closings now give up" in shown.out
    assert REPORT not in {m.key for m in everything(new)}
    fused = new.with_name("fused.mcap")
    assert crossfix("refuse", new, "-o", fused).code == 0
    assert crossfix("verify", fused, "--refuse").code == 0
    corrections = [m.decode() for m in everything(fused) if m.address.topic is keys.CORRECTION]
    assert {c.state for c in corrections} <= {"off", "observing"}
    assert all(c.own_axes is None for c in corrections)


@pytest.mark.parametrize("role", ["input", "output"])
def test_one_role(role: str, path: Path, new: Path, crossfix: Crossfix) -> None:
    crossfix("cut", path, "--role", role, "-o", new)
    assert everything(new) == [m for m in everything(path) if m.address.topic.role == role]
    assert roles(new) == {role}


def test_keys_by_pattern(path: Path, new: Path, crossfix: Crossfix) -> None:
    crossfix("cut", path, "--keys", "report/**", "--keys", "quality/*", "-o", new)
    assert {m.address.topic for m in everything(new)} == {keys.REPORT, keys.QUALITY}
    assert all(isinstance(m.decode(), SourceReport) for m in everything(new) if "report" in m.key)


def test_a_late_message_that_is_left_out_is_late_no_more(
    path: Path, new: Path, crossfix: Crossfix
) -> None:
    def late(message):
        if message.address.topic is not keys.CLOSED_FUSION:
            return [message]
        return [late_closing(message)]

    spoilt = remade(path, path.with_name("late.mcap"), late)
    assert crossfix("verify", spoilt).code == 0
    crossfix("cut", spoilt, "--without", "report/b/*", "-o", new)
    closings = [m.decode() for m in everything(new) if m.address.topic is keys.CLOSED_FUSION]
    assert all(not closed.late for closed in closings)
    assert crossfix("verify", new).code == 0


def late_closing(message):
    """Step 2 gives report 2 of b up, step 3 has it late."""
    closed = message.decode()
    span = StreamSpan(carrier="b", boot="b1", stream="radar", first=2, last=2)
    if closed.step == 2:
        closed = replace(closed, gave_up=[span])
    if closed.step == 3:
        closed = replace(closed, late=[span])
    return message._replace(payload=codec.encode(closed))


def test_of_a_torn_recording(tmp_path: Path, new: Path, crossfix: Crossfix) -> None:
    record_torn(tmp_path / "torn.mcap")
    assert crossfix("cut", tmp_path / "torn.mcap", "-o", new).code == 0
    with open_recording(new) as recording:
        assert recording.end is not None
        assert recording.end.torn
        assert recording.condition == ""


@pytest.mark.parametrize(
    "options",
    [
        ("--start", -1),
        ("--start", 3, "--until", 3),
        ("--start", 1000),
        ("--keys", "nothing/*"),
        ("--role", "nobody"),
        ("--start", "nan"),
    ],
)
def test_what_means_nothing_writes_nothing(
    options: tuple, path: Path, new: Path, crossfix: Crossfix
) -> None:
    shown = crossfix("cut", path, *options, "-o", new)
    assert shown.code == 2
    assert shown.err
    assert [p.name for p in new.parent.iterdir()] == [path.name]
