"""`export`: files pass the schemas of those they are for, and put things where they are."""

import csv
import errno
import json
import sys
from math import degrees
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader
from msgspec.structs import replace

from crossfix.analysis import open_recording
from crossfix.evaluation import symmetric
from crossfix.export import shapes
from crossfix.export.foxglove import Translator
from crossfix.export.situation import Situation, corrected
from estimation.frames import Site, enu_from_geodetic, target_from_source
from schemas import codec, keys
from schemas import messages as m
from tests.crossfix.conftest import Crossfix
from tests.crossfix.czml_schema import DOCUMENT, PACKET
from tests.crossfix.foxglove_schemas import SCHEMAS
from tests.crossfix.remade import everything, remade
from tests.crossfix.report_recordings import whole
from tests.crossfix.small_recording import REPORT, record, record_torn


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two ships, to which pictures, an operator and a lost range have been added."""
    folder = tmp_path_factory.mktemp("export")
    record(folder / "plain.mcap")

    def add(message):
        yield message
        if message.address.topic is keys.QUALITY:
            yield message._replace(**picture(message))

    def lose_ranges(message):
        if message.key == REPORT and message.sequence == 2:
            report = message.decode()
            n = len(report)
            columns = {"range_m": [None] * n, "sigma_range_m": None, "covariance_polar": None}
            return [message._replace(payload=codec.encode(replace(report, **columns)))]
        return add(message)

    return remade(folder / "plain.mcap", folder / "small.mcap", lose_ranges)


def picture(message) -> dict:
    quality = message.decode()
    track = m.Track(
        id="t1", position_m=[100.0, 200.0], velocity_mps=[1.0, 2.0], existence=0.9,
        covariance=[25.0, 0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 1.0, 0.0, 1.0],
    )  # fmt: skip
    tracks = m.Tracks(
        centre=quality.centre, seq=quality.seq, step=quality.step, t_ns=quality.t_ns, tracks=[track]
    )
    key = keys.TRACK.key(message.address.run, quality.centre)
    return {
        "key": key,
        "address": keys.parse(key),
        "payload": codec.encode(tracks),
        "encoding": codec.encoding_of(m.Tracks),
    }


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated run, with its truth."""
    return whole(tmp_path_factory.mktemp("simulated"))


def foxglove(path: Path) -> list[tuple]:
    with path.open("rb") as file:
        return [
            (schema, channel.topic, message.log_time, json.loads(message.data))
            for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages()
        ]


@pytest.mark.parametrize("which", ["path", "simulated"])
def test_foxglove_passes_its_schemas_and_its_own(
    which: str, tmp_path: Path, crossfix: Crossfix, request: pytest.FixtureRequest
) -> None:
    out = tmp_path / "out.mcap"
    shown = crossfix("export", "foxglove", request.getfixturevalue(which), "-o", out)
    assert shown.code == 0, shown
    written = foxglove(out)
    theirs = {name: Draft202012Validator(schema) for name, schema in SCHEMAS.items()}
    assert {schema.name for schema, *_ in written} == set(theirs)
    for schema, _, _, message in written:
        theirs[schema.name].validate(message)
    for schema in {schema.name: schema for schema, *_ in written}.values():
        assert schema.encoding == "jsonschema"
        assert b"$ref" not in schema.data
        own = Draft202012Validator(json.loads(schema.data))
        for other, _, _, message in written:
            if other.name == schema.name:
                own.validate(message)


def test_every_frame_that_is_drawn_in_has_been_placed(
    simulated: Path, tmp_path: Path, crossfix: Crossfix
) -> None:
    crossfix("export", "foxglove", simulated, "-o", tmp_path / "out.mcap")
    placed, topics = {"picture"}, set()
    for _, topic, _, message in foxglove(tmp_path / "out.mcap"):
        topics.add(topic.split("/")[1])
        for transform in message.get("transforms", ()):
            assert transform["parent_frame_id"] in placed
            placed.add(transform["child_frame_id"])
        for entity in message.get("entities", ()):
            assert entity["frame_id"] in placed
    assert {"alpha", "bravo", "bravo/corrected", "truth"} <= placed
    assert topics >= {"tf", "fix", "carriers", "logs", "corrected", "corrections", "truth", "log"}


def test_logs_without_a_range_are_lines_and_the_others_ellipses(
    path: Path, tmp_path: Path, crossfix: Crossfix
) -> None:
    crossfix("export", "foxglove", path, "-o", tmp_path / "out.mcap")
    reports = {m.decode().t_ns: m.decode() for m in everything(path) if m.key == REPORT}
    drawn = 0
    for _, topic, _, message in foxglove(tmp_path / "out.mcap"):
        if topic != "/logs/b/radar":
            continue
        (entity,) = message["entities"]
        t_ns = entity["timestamp"]["sec"] * 10**9 + entity["timestamp"]["nsec"]
        report = reports[t_ns]
        if report.range_m[0] is None:
            (lines,) = entity["lines"]
            assert len(lines["points"]) == 2 * len(report)
            end = lines["points"][1]
            bearing = np.arctan2(end["x"], end["y"])
            assert np.cos(bearing - report.bearing_rad[0]) == pytest.approx(1.0)
            drawn += 1
        else:
            assert len(entity["spheres"]) == len(report)
            centre = entity["spheres"][0]["pose"]["position"]
            assert np.hypot(centre["x"], centre["y"]) == pytest.approx(report.range_m[0], rel=1e-4)
    assert drawn == 1


def test_an_ellipse_is_two_sigmas_of_its_covariance() -> None:
    turn = np.radians(30.0)
    axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    covariance = axes @ np.diag([40.0**2, 10.0**2]) @ axes.T
    drawn = shapes.ellipsoid(np.array([1.0, 2.0]), covariance, shapes.TRUTH)
    assert sorted([drawn.size.x, drawn.size.y]) == pytest.approx([4 * 10.0, 4 * 40.0])
    q = drawn.pose.orientation
    first = 2 * np.arctan2(q.z, q.w)  # direction of the x axis, whose full length is size.x
    longest = turn if drawn.size.x > drawn.size.y else turn + np.pi / 2
    assert abs(np.cos(first - longest)) == pytest.approx(1.0)


def test_a_quaternion_turns_as_its_matrix_does() -> None:
    chance = np.random.default_rng(7)
    for _ in range(50):
        rotation, _ = np.linalg.qr(chance.normal(size=(3, 3)))
        rotation *= np.sign(np.linalg.det(rotation))
        q = shapes.quaternion(rotation)
        v = chance.normal(size=3)
        axis = np.array([q.x, q.y, q.z])
        turned = v + 2 * np.cross(axis, np.cross(axis, v) + q.w * v)
        np.testing.assert_allclose(turned, rotation @ v, atol=1e-12)


def test_an_applied_correction_places_its_carrier_where_it_says(simulated: Path) -> None:
    with open_recording(simulated) as recording:
        now = Situation(recording.scenario)
        applied = [c for c in recording.read(m.Correction) if c.state == "applied"]
        found = corrected(now, applied[-1])
    axes, own, other = applied[-1].own_axes, applied[-1].own_pose, applied[-1].other_pose
    np.testing.assert_allclose(found.own_from_other.translation_m[:2], [axes.east_m, axes.north_m])
    np.testing.assert_allclose(found.covariance, symmetric(axes.covariance)[:2, :2])
    own_site = Site(own.latitude_rad, own.longitude_rad, own.altitude_m)
    back = enu_from_geodetic(own_site, *found.place)
    np.testing.assert_allclose(back[:2], [axes.east_m, axes.north_m], atol=1e-6)
    known = target_from_source(own_site, Site(other.latitude_rad, other.longitude_rad))
    north = found.own_from_other.rotation @ [0.0, 1.0, 0.0]
    east, up_north, _ = known.rotation @ [0.0, 1.0, 0.0]
    turn = np.arctan2(north[0], north[1]) - np.arctan2(east, up_north)
    assert turn == pytest.approx(axes.rotation_rad, abs=1e-12)


def test_what_has_happened_is_logged() -> None:
    scenario = SimpleNamespace(
        carriers=[], fusion={"own": "a"},
        origin=SimpleNamespace(latitude_rad=0.0, longitude_rad=0.0, altitude_m=0.0),
    )  # fmt: skip
    translator = Translator(scenario)
    said = [
        m.Health(centre="f", t_ns=1, step=1, news=["b lost"]),
        m.Event(centre="f", seq=1, step=1, t_ns=2, id="x", kind="suspend", carrier="b"),
        m.Correction(
            centre="f", seq=1, step=1, t_ns=3, carrier="b", id="b-1", state="suspended", reason="no"
        ),
        m.Quality(centre="f", seq=1, step=1, t_ns=4,
                  sources=[m.SourceQuality(carrier="b", source="s", flag="loud")]),
    ]  # fmt: skip
    logs = [out.message for message in said for out in translator.translate(message)]
    assert [log.message for log in logs] == [
        "b lost", "operator: suspend b", "correction of b: suspended, no", "b/s: loud",
    ]  # fmt: skip
    assert [log.level for log in logs] == [2, 2, 3, 3]
    assert list(translator.translate(said[-1])) == []  # it is told once


@pytest.mark.parametrize("which", ["path", "simulated"])
def test_czml_passes_its_schema(
    which: str, tmp_path: Path, crossfix: Crossfix, request: pytest.FixtureRequest
) -> None:
    out = tmp_path / "out.czml"
    assert crossfix("export", "czml", request.getfixturevalue(which), "-o", out).code == 0
    document, *packets = json.loads(out.read_text())
    Draft202012Validator(DOCUMENT).validate(document)
    for packet in packets:
        Draft202012Validator(PACKET).validate(packet)
    names = [packet["id"] for packet in packets]
    assert len(set(names)) == len(names)
    kinds = {name.split("/")[0] for name in names}
    assert kinds >= {"reported", "corrected"}
    assert kinds >= ({"truth"} if which == "simulated" else {"track", "bearing"})


def test_czml_puts_carriers_where_they_say_they_are(
    path: Path, tmp_path: Path, crossfix: Crossfix
) -> None:
    crossfix("export", "czml", path, "-o", tmp_path / "out.czml")
    packets = {packet["id"]: packet for packet in json.loads((tmp_path / "out.czml").read_text())}
    with open_recording(path) as recording:
        said = list(recording.read(m.Navigation, carrier="b"))
    samples = np.reshape(packets["reported/b"]["position"]["cartographicDegrees"], (-1, 4))
    np.testing.assert_allclose(samples[:, 0], [(n.t_ns - said[0].t_ns) * 1e-9 for n in said])
    np.testing.assert_allclose(samples[:, 1], [degrees(n.pose.longitude_rad) for n in said])
    np.testing.assert_allclose(samples[:, 2], [degrees(n.pose.latitude_rad) for n in said])


def test_csv_is_the_columns(path: Path, tmp_path: Path, crossfix: Crossfix) -> None:
    facts = json.loads(crossfix("export", "csv", path, "-o", tmp_path / "out", "--json").out)
    files = {Path(file["path"]).stem: file for file in facts["files"]}
    assert {"report", "correction", "track", "closed_fusion"} <= set(files)
    with open_recording(path) as recording:
        for topic in ("report", "correction"):
            columns = recording.columns(topic)
            with (tmp_path / "out" / f"{topic}.csv").open(newline="") as file:
                rows = list(csv.DictReader(file))
            assert list(rows[0]) == list(columns)
            assert len(rows) == columns.rows == files[topic]["rows"]
            for name, column in columns.items():
                if column.dtype.kind == "f":
                    values = [float(row[name]) if row[name] else np.nan for row in rows]
                    np.testing.assert_array_equal(values, column)  # every digit is there


def test_csv_of_one_topic(path: Path, tmp_path: Path, crossfix: Crossfix) -> None:
    crossfix("export", "csv", path, "--topic", "quality", "-o", tmp_path / "out")
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["quality.csv"]


def test_a_torn_recording_is_exported_as_far_as_it_goes(tmp_path: Path, crossfix: Crossfix) -> None:
    record_torn(tmp_path / "torn.mcap")
    for form in ("foxglove", "csv", "czml"):
        assert crossfix("export", form, tmp_path / "torn.mcap").code == 0
    names = {file.name for file in tmp_path.iterdir()}
    assert {"torn.foxglove.mcap", "torn-csv", "torn.czml"} <= names


def test_rerun_is_an_extra(
    path: Path, tmp_path: Path, crossfix: Crossfix, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)  # as if it were not installed
    shown = crossfix("export", "rerun", path, "-o", tmp_path / "out.rrd")
    assert shown.code == 2
    assert "pip install 'crossfix[rerun]'" in shown.err
    assert list(tmp_path.iterdir()) == []


def test_rerun_writes_its_archetypes(simulated: Path, tmp_path: Path, crossfix: Crossfix) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is an optional extra")
    out = tmp_path / "out.rrd"
    assert crossfix("export", "rerun", simulated, "-o", out).code == 0
    assert out.read_bytes()[:3] == b"RRF"


@pytest.mark.parametrize(
    "arguments",
    [
        ("foxglove", "none.mcap"), ("csv", "."), ("rosbag", "none.mcap"),
        ("czml", "none.mcap", "--topic", "report"),
    ],
)  # fmt: skip
def test_what_cannot_be_exported_is_one_line(arguments: tuple, crossfix: Crossfix) -> None:
    shown = crossfix("export", *arguments)
    assert shown.code == 2
    assert shown.err


def test_nothing_is_overwritten(path: Path, tmp_path: Path, crossfix: Crossfix) -> None:
    for form in ("foxglove", "csv", "czml"):
        out = tmp_path / form
        out.mkdir()
        shown = crossfix("export", form, path, "-o", out)
        assert shown.code == 2
        assert len(shown.err.splitlines()) == 1
        assert list(out.iterdir()) == []
    shown = crossfix("export", "csv", path, "--topic", "nothing", "-o", tmp_path / "new")
    assert shown.code == 2
    assert not (tmp_path / "new").exists()


def test_a_full_disk_is_one_line_and_leaves_nothing(
    path: Path, tmp_path: Path, crossfix: Crossfix, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("schemas.recording.plain_file.os.write", full)
    shown = crossfix("export", "foxglove", path, "-o", tmp_path / "out.mcap")
    assert shown.code == 2
    assert "No space left" in shown.err
    assert len(shown.err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
