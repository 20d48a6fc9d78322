"""Recorded tracks: what a file says is what is there, and nothing where it is silent."""

import gzip
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimation.frames import Site, geodetic_from_enu
from schemas.errors import ScenarioError
from sim_world.scenario import Scenario, parse_scenario
from sim_world.scenario.motions import Columns, TrackFile
from sim_world.scenario.toml_text import toml_text
from sim_world.tracks_csv import Recordings, read_reports, recordings
from sim_world.world import World
from tests.sim_world.scenes import carrier, tree

DATA = Path(__file__).parents[3] / "shared" / "data" / "real"
ORIGIN = Site(np.radians(50.76), np.radians(-1.12))
HEADER = "when,who,lat,lon,kn,cog\n"
LINES = (
    "2026-01-01 00:00:00,111,50.800,-1.100,10,0\n"
    "2026-01-01T00:01:00Z,111,50.803,-1.100,10,0\n"
    "2026-01-01 00:00:10.500,222,50.700,-1.000,,\n"
    "2026-01-01 01:02:00+01:00,111,50.806,-1.100,102.3,360\n"
    "2026-01-01 00:09:00,111,50.806,-1.090,0,90\n"
    "2026-01-01 00:09:30,111,50.806,-1.090,0,90\n"
    ",111,50.9,-1.1,0,0\n"
    "2026-01-01 00:09:31,111,,,0,0\n"
)
COLUMNS: dict[str, str] = {
    "time": "when", "id": "who", "latitude_deg": "lat", "longitude_deg": "lon",
    "speed_knots": "kn", "course_deg": "cog",
}  # fmt: skip
START = datetime(2026, 1, 1, tzinfo=UTC)


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    path = tmp_path / "tracks.csv"
    path.write_text(HEADER + LINES)
    return path


def file(**keys: Any) -> TrackFile:
    return TrackFile(file="tracks.csv", columns=Columns(**COLUMNS), start=START, **keys)


def loaded(path: Path, **keys: Any) -> Recordings:
    tracks = file(**keys)
    reports = read_reports(path, tracks.columns)
    return Recordings(ORIGIN, [(r, tracks) for r in recordings(reports, tracks, ORIGIN)])


def with_tracks(folder: Path, **tables: Any) -> Scenario:
    text = toml_text(tree([carrier()], targets=[], origin=ORIGIN_TABLE, **tables))
    return parse_scenario(text, folders=(folder,))


ORIGIN_TABLE = {"latitude_deg": 50.76, "longitude_deg": -1.12}
TRACKS = {"name": "ais", "file": "tracks.csv", "start": START, "columns": COLUMNS}


def test_times_may_have_a_zone_or_be_unix_seconds(plain: Path, tmp_path: Path) -> None:
    times = [r.time_s for r in read_reports(plain, Columns(**COLUMNS)) if r.id == "111"]
    assert np.array_equal(np.array(times) - START.timestamp(), [0, 60, 120, 540, 570])
    other = tmp_path / "unix.csv"
    other.write_text("\ufeff" + HEADER + "1767225600.25,9,50,1,,\n")
    assert read_reports(other, Columns(**COLUMNS))[0].time_s == 1767225600.25


def test_zipped_is_the_same(plain: Path, tmp_path: Path) -> None:
    zipped = tmp_path / "tracks.csv.gz"
    zipped.write_bytes(gzip.compress(plain.read_bytes()))
    one, other = (read_reports(p, Columns(**COLUMNS)) for p in (plain, zipped))
    assert np.array_equal(
        np.array([r[1:] for r in one]), np.array([r[1:] for r in other]), equal_nan=True
    )


def test_a_track_passes_through_its_reports(plain: Path) -> None:
    tracks = loaded(plain)
    for t, latitude, longitude in ((0, 50.8, -1.1), (60, 50.803, -1.1), (119.999999, 50.806, -1.1)):
        kinematics, exists = tracks.at(t)
        assert exists.tolist() == [True]
        found = np.degrees(geodetic_from_enu(ORIGIN, kinematics.position_m[:1]))[:2, 0]
        assert np.allclose(found, [latitude, longitude], atol=1e-7)


def test_tracks_with_a_single_report_are_left_out(plain: Path) -> None:
    tracks = file()
    assert [r.id for r in recordings(read_reports(plain, tracks.columns), tracks, ORIGIN)] == [
        "111"
    ]


def test_there_is_nobody_before_after_and_in_a_silence(plain: Path) -> None:
    tracks = loaded(plain)
    seen = {t: bool(tracks.at(t)[1][0]) for t in (-1, 0, 119, 130, 300, 539, 541, 570, 571)}
    assert seen == {
        -1: False, 0: True, 119: True, 130: False, 300: False, 539: False, 541: True, 570: True,
        571: False,
    }  # fmt: skip
    assert loaded(plain, max_gap_s=1000).at(300)[1][0]


def test_velocity_is_the_reported_one_unless_it_contradicts_the_places(plain: Path) -> None:
    kinematics, _ = loaded(plain).at(0)
    assert np.allclose(kinematics.velocity_mps[0, :2], [0, 10 * 1852 / 3600], atol=0.02)
    at_120 = loaded(plain, max_gap_s=1000).at(120)[0].velocity_mps[0]
    assert np.linalg.norm(at_120) < 10  # not 102.3 knots, which is AIS for unknown


@pytest.mark.parametrize("resample", ["cubic", "linear"])
def test_velocity_and_acceleration_are_the_derivatives(plain: Path, resample: str) -> None:
    tracks, h = loaded(plain, resample=resample), 1e-3
    for t in (17.0, 91.0, 555.0):
        before, now, after = (tracks.at(t + d)[0] for d in (-h, 0, h))
        difference = (after.position_m - before.position_m) / (2 * h)
        assert np.allclose(difference, now.velocity_mps, atol=1e-3)  # Earth as a sphere
        bend = (after.velocity_mps - before.velocity_mps) / (2 * h)
        assert np.allclose(bend, now.acceleration_mps2, atol=1e-4)


def test_close_reports_are_thinned(plain: Path) -> None:
    reports = read_reports(plain, Columns(**COLUMNS))
    counts = [
        len(next(recordings(reports, file(min_interval_s=interval), ORIGIN)).t_s)
        for interval in (0, 31, 61, 400)
    ]
    assert counts == [5, 4, 3, 2]


@pytest.mark.parametrize("field", COLUMNS)
def test_a_missing_column_is_named_with_those_there_are(plain: Path, field: str) -> None:
    columns = Columns(**{**COLUMNS, field: "nowhere"})
    with pytest.raises(ScenarioError, match=rf"columns\.{field}.*nowhere.*when, who, lat"):
        read_reports(plain, columns)


@pytest.mark.parametrize(
    ("line", "named"),
    [("yesterday,1,5,5,1,1", "when"), ("2026-01-01,1,5x,5,1,1", "lat"), ("0,1,5,5,fast,1", "kn")],
)
def test_an_unreadable_cell_is_named_with_its_line(plain: Path, line: str, named: str) -> None:
    plain.write_text(HEADER + LINES + line + "\n")
    with pytest.raises(ScenarioError, match=rf"tracks\.csv line 10: {named}"):
        read_reports(plain, Columns(**COLUMNS))


@pytest.mark.parametrize("content", [b"\x1f\x8b\x08broken", b"", b"not a gzip"])
def test_a_broken_file_is_a_scenario_error(tmp_path: Path, content: bytes) -> None:
    broken = tmp_path / "tracks.csv.gz"
    broken.write_bytes(content)
    with pytest.raises(ScenarioError, match=r"tracks\.csv\.gz"):
        read_reports(broken, Columns(**COLUMNS))


def test_a_world_shows_recorded_targets_while_they_are_reported(plain: Path) -> None:
    scenario = with_tracks(plain.parent, tracks=[TRACKS], time={"duration_s": 600, "step_s": 10})
    world = World(scenario)
    assert world.step(1)[0].identity == ["111"]
    assert world.step(30)[0].identity == []
    assert world.step(55)[0].number == world.step(1)[0].number


def test_one_track_can_be_a_target_of_its_own(plain: Path) -> None:
    motion = {k: v for k, v in TRACKS.items() if k != "name"} | {"kind": "track", "id": 111}
    assert World(with_tracks(plain.parent)).step(1)[0].number == []
    text = toml_text(
        tree(targets=[{"name": "ferry", "start_s": 20.0, "motion": motion}], origin=ORIGIN_TABLE)
    )
    world = World(parse_scenario(text, folders=(plain.parent,)))
    assert [len(world.step(k)[0].number) for k in (10, 30)] == [0, 1]
    all_of_it = World(with_tracks(plain.parent, tracks=[TRACKS]))
    assert world.step(30)[0].position_m == all_of_it.step(30)[0].position_m


def test_a_track_that_is_not_in_the_file_is_named(plain: Path) -> None:
    scenario = with_tracks(plain.parent, tracks=[{**TRACKS, "ids": [111, 333]}])
    with pytest.raises(ScenarioError, match="333"):
        World(scenario)


@pytest.mark.skipif(not DATA.is_dir(), reason="no shared data here")
def test_left_out_reports_of_the_solent_lie_near_the_resampled_tracks() -> None:
    columns = Columns(
        time="Time", id="MMSI", latitude_deg="Latitude_degrees", longitude_deg="Longitude_degrees",
        speed_knots="SOG_knots", course_deg="COG_degrees",
    )  # fmt: skip
    start = datetime(2016, 1, 12, 13, 0, tzinfo=UTC)
    tracks = TrackFile(file="", columns=columns, start=start)
    reports = read_reports(DATA / "solent_ais_20160112.csv.gz", columns)
    assert len(reports) == 18_623
    found = list(recordings(reports, tracks, ORIGIN, min_reports=100))
    every = TrackFile(file="", columns=columns, start=start, min_interval_s=0)
    errors = []
    for full in recordings(reports, every, ORIGIN, min_reports=100):
        thinned = Recordings(ORIGIN, [(r, tracks) for r in found if r.id == full.id])
        for t, place in zip(full.t_s[5:-5:7], full.position_m[5:-5:7], strict=True):
            kinematics, exists = thinned.at(t)
            if exists[0]:
                errors.append(np.linalg.norm(kinematics.position_m[0, :2] - place[:2]))
    assert len(errors) > 1500
    assert np.median(errors) < 1.0
    assert np.percentile(errors, 99) < 25  # the reports' own time stamps are uncertain by 2 s
