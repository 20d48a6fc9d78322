"""`diff`: what is the same is the same however it is packed; what is not is named to the field."""

import json
import re
from pathlib import Path

import pytest
from mcap.writer import CompressionType, Writer

from crossfix.differences import EXACT, Rules, changes, diff, unpacked
from schemas import keys
from schemas.recording.reader import digests, open_recording
from tests.crossfix.conftest import Crossfix
from tests.crossfix.remade import everything, remade, with_field
from tests.crossfix.small_recording import CORRECTION, REPORT, STEPS, record

TINY = 1e-15


@pytest.fixture
def path(tmp_path: Path) -> Path:
    record(tmp_path / "small.mcap")
    return tmp_path / "small.mcap"


@pytest.fixture
def other(tmp_path: Path) -> Path:
    return tmp_path / "other.mcap"


def channel(key: str) -> str:
    return key.split("/", 3)[3]


def altered(path: Path, other: Path, key: str, sequence: int, *field: str, value: object) -> Path:
    def change(message):
        if (message.key, message.sequence) == (key, sequence):
            return [with_field(message, *field, value=value)]
        return [message]

    return remade(path, other, change)


def packed_otherwise(path: Path, other: Path) -> None:
    """By the plain library, each message in a chunk of its own."""
    with open_recording(path) as recording, other.open("wb") as file:
        writer = Writer(file, chunk_size=1, compression=CompressionType.LZ4)
        writer.start(profile="crossfix")
        for metadata in recording.index.metadata:
            writer.add_metadata(metadata.name, metadata.metadata)
        for a in recording.attachments.values():
            writer.add_attachment(0, 0, a.name, a.media_type, a.data)
        ids = {}
        for message in recording.messages():
            if message.key not in ids:
                schema = writer.register_schema("x", "", b"")
                ids[message.key] = writer.register_channel(message.key, "msgpack", schema)
            writer.add_message(
                ids[message.key], 7, message.payload, message.publish_time_ns, message.sequence
            )
        writer.finish()


def test_a_recording_is_the_same_as_itself(path: Path, crossfix: Crossfix) -> None:
    shown = crossfix("diff", path, path)
    assert shown.code == 0
    assert "the same" in shown.out
    assert "byte for byte" in shown.out


def test_chunks_compression_and_log_times_do_not_matter(
    path: Path, other: Path, crossfix: Crossfix
) -> None:
    packed_otherwise(path, other)
    assert other.read_bytes() != path.read_bytes()
    facts = json.loads(crossfix("diff", path, other, "--json").out)
    assert facts["same"] is True
    with open_recording(path) as recording:
        wanted = {channel(key): digest for key, digest in digests(recording).items()}
    found = {c["channel"]: c for c in facts["channels"]}
    for name, digest in wanted.items():
        assert found[name]["digest_before"] == found[name]["digest_after"] == digest


def test_a_change_of_1e_15_in_one_payload_is_named(
    path: Path, other: Path, crossfix: Crossfix
) -> None:
    altered(path, other, REPORT, 4, "bearing_rad", value=lambda b: [b[0] + TINY, *b[1:]])
    shown = crossfix("diff", path, other)
    assert shown.code == 1
    assert f"{channel(REPORT)}, seq 4" in shown.out
    assert "bearing_rad[0] was" in shown.out
    facts = json.loads(crossfix("diff", path, other, "--json").out)
    first = facts["first"]
    assert (first["sequence"], first["field"]) == (4, "bearing_rad[0]")
    assert abs(first["after"] - first["before"]) == pytest.approx(TINY, rel=0.2)
    (field,) = facts["fields"]
    assert (field["field"], field["values"], field["messages"]) == ("bearing_rad[]", 1, 1)
    assert field["greatest"] == pytest.approx(TINY, rel=0.2)
    assert sum(c["changed"] for c in facts["channels"]) == 1


def test_a_tolerance_takes_it_for_the_same(path: Path, other: Path, crossfix: Crossfix) -> None:
    altered(path, other, REPORT, 4, "bearing_rad", value=lambda b: [b[0] + TINY, *b[1:]])
    shown = crossfix("diff", path, other, "--tolerance", "1e-9")
    assert shown.code == 0
    assert "1 of them within the tolerance" in shown.out


def test_whole_numbers_have_no_tolerance(path: Path, other: Path, crossfix: Crossfix) -> None:
    altered(path, other, CORRECTION, 2, "valid_t_ns", value=lambda t: t + 1)
    shown = crossfix("diff", path, other, "--tolerance", "1e-3")
    assert shown.code == 1
    assert "valid_t_ns" in shown.out


def test_the_earliest_difference_comes_first_and_inputs_before_outputs(
    path: Path, other: Path
) -> None:
    def change(message):
        if message.key == CORRECTION and message.sequence >= 3:
            return [with_field(message, "reason", value="altered")]
        if message.key == REPORT and message.sequence >= 3:
            return [with_field(message, "range_m", value=lambda r: [x + 1 for x in r])]
        return [message]

    remade(path, other, change)
    with open_recording(path) as before, open_recording(other) as after:
        found = diff(before, after)
        assert found.first is not None
        assert (found.first.channel, found.first.sequence) == (channel(REPORT), 3)
        ranges = next(f for f in found.fields if f.field == "range_m[]")
        assert ranges.mean == ranges.rms == ranges.greatest == pytest.approx(1.0)
        texts = next(f for f in found.fields if f.field == "reason")
        assert texts.unlike == texts.values == STEPS - 2


def test_a_message_that_one_of_them_lacks(path: Path, other: Path, crossfix: Crossfix) -> None:
    remade(path, other, lambda m: [] if (m.key, m.sequence) == (CORRECTION, 5) else [m])
    for pair, side in (((path, other), "first"), ((other, path), "second")):
        shown = crossfix("diff", *pair)
        assert shown.code == 1
        assert f"{channel(CORRECTION)}, seq 5" in shown.out
        assert f"only the {side} recording has this message" in shown.out
    facts = json.loads(crossfix("diff", path, other, "--json").out)
    (found,) = (c for c in facts["channels"] if c["channel"] == channel(CORRECTION))
    assert (found["only_before"], found["only_after"], found["changed"]) == (1, 0, 0)


def test_the_order_of_arrival_is_no_difference(path: Path, other: Path, crossfix: Crossfix) -> None:
    held = []

    def late(message):
        if (message.key, message.sequence) == (REPORT, 2):
            held.append(message)
            return []
        return [message, held.pop()] if held and message.sequence == 4 else [message]

    remade(path, other, late)
    assert crossfix("diff", path, other).code == 0


def test_settings_of_one_registration_and_one_association_parameter_are_summed_up(
    path: Path, other: Path, crossfix: Crossfix
) -> None:
    settings = ("--set", "registration.method=adjustment", "--set", "association.gate=1.5")
    assert crossfix("refuse", path, *settings, "-o", other).code == 0
    shown = crossfix("diff", path, other)
    assert shown.code == 1
    assert "setting association.gate: 9.21 -> 1.5" in shown.out
    assert re.search(r"setting registration.method: \w+ -> adjustment", shown.out)
    assert "own_axes.east_m" in shown.out
    facts = json.loads(crossfix("diff", path, other, "--json").out)
    changed = {c["channel"] for c in facts["channels"] if c["changed"]}
    assert channel(CORRECTION) in changed
    assert all(
        keys.parse(f"{keys.PREFIX}/r/{name}").topic.role is keys.Role.OUTPUT for name in changed
    )
    (east,) = (f for f in facts["fields"] if f["field"] == "own_axes.east_m")
    assert 0 < abs(east["mean"]) <= 1.001 * east["rms"] <= 1.002 * east["greatest"]


def test_fields_and_channels_can_be_left_out(path: Path, other: Path, crossfix: Crossfix) -> None:
    altered(path, other, REPORT, 1, "boot", value="b9")
    assert crossfix("diff", path, other).code == 1
    assert crossfix("diff", path, other, "--ignore", "boot").code == 0
    assert crossfix("diff", path, other, "--keys", "correction/**").code == 0
    assert crossfix("diff", path, other, "--role", "output").code == 0


def test_nothing_to_compare_is_an_error(path: Path, crossfix: Crossfix) -> None:
    shown = crossfix("diff", path, path, "--keys", "alignment/**")
    assert shown.code == 2
    assert "nothing to compare" in shown.err


def test_a_file_that_cannot_be_read_is_an_error(
    path: Path, other: Path, crossfix: Crossfix
) -> None:
    other.write_text("no MCAP")
    for pair in ((path, other), (other, path), (path, path.parent), (path, other / "none")):
        shown = crossfix("diff", *pair)
        assert shown.code == 2
        assert len(shown.err.splitlines()) == 1


@pytest.mark.parametrize(
    ("before", "after", "rules", "paths"),
    [
        ({"a": 1, "b": [1.0, 2.0]}, {"a": 1, "b": [1.0, 2.0]}, EXACT, []),
        ({"a": 1}, {"a": 1.0}, EXACT, ["a"]),
        ({"a": 1}, {"a": 1.0}, Rules(1e-9), []),
        ({"a": True}, {"a": 1}, Rules(1e-9), ["a"]),
        ({"a": 1e9}, {"a": 1e9 + 0.5}, Rules(1e-9), []),
        ({"a": 1e9}, {"a": 1e9 + 2}, Rules(1e-9), ["a"]),
        ({"a": 1.0}, {"a": None}, Rules(1e-9), ["a"]),
        ({"a": {"boot": 1, "c": 2}}, {"a": {"boot": 2, "c": 3}}, Rules(0, ["boot"]), ["a.c"]),
        ({"t": [{"id": "p", "x": 1}, {"id": "q", "x": 2}]},
         {"t": [{"id": "q", "x": 2}, {"id": "p", "x": 4}]}, EXACT, ["t[p].x"]),
        ({"t": [{"id": "p"}]}, {"t": [{"id": "p"}, {"id": "q"}]}, EXACT, ["t[q]"]),
        ({"t": [{"id": "p", "x": 1}] * 2}, {"t": [{"id": "p", "x": 2}] * 2}, EXACT,
         ["t[0].x", "t[1].x"]),
    ],
)  # fmt: skip
def test_which_fields_differ(before, after, rules: Rules, paths: list[str]) -> None:
    assert [change.path for change in changes(before, after, rules)] == paths


def test_what_cannot_be_unpacked_is_compared_by_its_bytes() -> None:
    assert unpacked(b"\xc1") == "c1"
    assert unpacked(b"{", "application/json") == "7b"


def test_every_message_of_a_run_is_compared(path: Path) -> None:
    with open_recording(path) as before, open_recording(path) as after:
        compared = sum(c.before for c in diff(before, after, roles=tuple(keys.Role)).channels)
    assert compared == len(everything(path))
