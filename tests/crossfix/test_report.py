"""The report of a recording: right figures, the same axes as the fusion, a page of its own."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from crossfix.evaluation import CUTOFF_M, names_changed, picture_errors
from crossfix.evaluation.recordings import frame_summaries, picture_summary
from crossfix.report.figures import Figures, nees_interval
from crossfix.report.markdown import markdown_page
from crossfix.report.series import frame_series, presence
from crossfix.report.story import Story, read_story
from crossfix.report.thinning import Thinned, stride
from crossfix.report.tracks import Scene, Track, found_lines, scene
from crossfix.report.writing import read_figures, write_page
from estimation.arrays import Array
from estimation.consistency import mean_interval
from estimation.metrics import identity_changes
from schemas import keys
from schemas.messages import BearingLine
from tests.crossfix import report_recordings as recordings
from tests.crossfix.conftest import Crossfix

DEADLINE_S = 120
MAX_BYTES = 8_000_000
LOADS = re.compile(r"<(?:link|iframe|img|script)[^>]*(?:src|href)\s*=|@import|url\(")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("reports")


@pytest.fixture(scope="module")
def whole(folder: Path) -> Path:
    return recordings.whole(folder)


@pytest.fixture(scope="module")
def blind(folder: Path, whole: Path) -> Path:
    truth = (keys.TRUTH_CARRIERS, keys.TRUTH_TARGETS)
    return recordings.without(whole, folder / "blind.mcap", *truth)


@pytest.fixture(scope="module")
def hostile(folder: Path) -> Path:
    return recordings.hostile(folder)


@pytest.fixture(scope="module")
def story(whole: Path) -> Story:
    return read_story(whole)


@pytest.fixture(scope="module")
def drawn(story: Story) -> Scene:
    return scene(story)


def written(recording: Path) -> tuple[Figures, str]:
    page = recording.with_suffix(".html")
    figures = write_page(recording, page)
    return figures, page.read_text(encoding="utf-8")


def test_figures_are_those_of_the_table(whole: Path) -> None:
    figures = read_figures(whole)
    assert [c.name for c in figures.carriers] == ["bravo"]
    for carrier, summary in zip(figures.carriers, frame_summaries(whole), strict=True):
        assert carrier.truth is not None
        assert carrier.truth.before_m == summary.before_m
        assert carrier.truth.after_m == summary.after_m
        assert carrier.truth.after_rad == summary.after_rad
        assert carrier.truth.sigma_m == summary.sigma_m
        assert carrier.truth.nees_per_dimension == pytest.approx(summary.nees / 3)
        assert carrier.state == summary.state


def test_picture_is_that_of_the_table(whole: Path, blind: Path) -> None:
    figures, summary = read_figures(whole), picture_summary(whole)
    assert summary is not None
    assert figures.picture is not None
    truth = figures.picture.truth
    assert truth is not None
    assert truth == summary
    unseen = read_figures(blind).picture
    assert unseen is not None
    assert unseen.tracks == figures.picture.tracks > 0
    assert unseen.truth is None
    assert abs(unseen.objects - unseen.tracks) < 1
    assert 0 < unseen.sigma_objects < 1
    assert picture_summary(blind) is None


def test_parts_of_gospa_add_up_in_squares_at_every_instant(story: Story) -> None:
    known = [*story.truth_targets, *story.truth_carriers, *story.navigation[story.own]]
    halved = [
        replace(picture, tracks=[*picture.tracks[::2], replace(picture.tracks[0], id="false")])
        for picture in story.pictures
        if picture.tracks
    ]
    errors = picture_errors(story.scenario, story.own, [*known, *halved])
    assert {error.missed > 0 and error.false > 0 for error in errors} == {True}
    for error in errors:
        parts = error.localisation_m**2 + error.missed_m**2 + error.false_m**2
        assert parts == pytest.approx(error.gospa_m**2)
        assert error.missed_m**2 == pytest.approx(error.missed * CUTOFF_M**2 / 2)


def test_names_changed_so_far_end_with_their_whole_number(story: Story) -> None:
    errors = [
        error._replace(pairs=tuple((target, track[: n % 3]) for target, track in error.pairs))
        for n, error in enumerate(story.picture_errors)  # names that change often
    ]
    held = [(n, *pair) for n, error in enumerate(errors) for pair in error.pairs]
    steps, targets, tracks = (np.array(column) for column in zip(*held, strict=True))
    so_far = names_changed(errors)
    assert so_far[-1] == identity_changes(steps, targets, tracks) > 0
    assert (np.diff(so_far) >= 0).all()


def test_no_picture_is_no_figure(folder: Path, whole: Path) -> None:
    bare = recordings.without(whole, folder / "unpictured.mcap", keys.TRACK)
    assert read_figures(bare).picture is None
    assert scene(read_story(bare)).found == []
    assert "## Picture" not in markdown_page(read_figures(bare))


def test_tracks_end_on_targets_within_their_ellipses(story: Story, drawn: Scene) -> None:
    shown = [track for track in drawn.found if track.last is not None]
    assert story.last_picture is not None
    assert [t.name for t in shown] == sorted(
        (t.id for t in story.last_picture.tracks), key=lambda name: (len(name), name)
    )
    ends = np.array([target.track.east_north_m[-1] for target in drawn.targets])
    for track in shown:
        assert track.last is not None
        away_m = np.hypot(*(ends - track.way.east_north_m[-1]).T).min()
        assert away_m < track.last.axes_m.max()  # four sigma of the longest axis
        assert (track.last.axes_m > 0).all()


def test_a_bearing_without_a_range_is_a_line_through_all_that_it_may_be(story: Story) -> None:
    assert story.last_picture is not None
    line = BearingLine(
        id="alpha/sonar/x", status="undetermined", t_ns=1, observer_m=[100.0, -50.0],
        bearing_rad=np.pi / 2, sigma_bearing_rad=0.01, range_low_m=2000.0, range_high_m=9000.0,
        motion="constant velocity", bearings=7,
    )  # fmt: skip
    found = replace(line, id="alpha/sonar/y", range_high_m=None)
    known = replace(line, id="alpha/sonar/z", status="determined")
    last = replace(story.last_picture, lines=[line, found, known])
    closed, open_ended = found_lines(story._replace(last_picture=last))
    assert closed.ends_m == pytest.approx(np.array([[2100, -50], [9100, -50]]))
    assert "2 km to 9 km" in closed.said
    assert open_ended.ends_m[1, 0] > 500_000
    assert "any farther" in open_ended.said


def test_band_of_nees_is_that_of_the_consistency_tests() -> None:
    assert nees_interval() == pytest.approx(mean_interval(3, 1))


def test_states_follow_each_other_without_a_gap(story: Story) -> None:
    for series in frame_series(story):
        spans = series.states
        assert [s.to_s for s in spans[:-1]] == [s.from_s for s in spans[1:]]
        assert all(a.name != b.name for a, b in pairwise(spans))
        assert spans[-1].to_s == story.time_s(story.end_ns)
        assert {"applied", "suspended"} <= {s.name for s in spans}  # it was killed and came back


def test_a_carrier_that_was_lost_is_absent_until_it_returns(story: Story) -> None:
    here = presence(story)
    assert len(here["alpha"]) == 1
    first, second = here["bravo"]
    assert first.from_s < first.to_s < second.from_s < second.to_s
    texts = [item.text for item in read_figures(Path(story.summary.path)).news]
    assert any("bravo is lost" in text for text in texts)


def test_own_carrier_is_the_gauge_of_the_picture(story: Story, drawn: Scene) -> None:
    own = drawn.carriers[0]
    assert own.name == story.own
    clock_m = 0.03 * 8  # what a clock error of 30 ms makes at 8 m/s
    assert distance_m(own.reported, own.true).max() < clock_m
    assert len(own.corrected.t_s) == len(own.ellipses) == 0


def test_corrections_put_carrier_and_logs_onto_the_truth(drawn: Scene) -> None:
    bravo = drawn.carriers[1]
    reported_m = np.nanmedian(distance_m(bravo.reported, bravo.true))
    corrected_m = np.nanmedian(distance_m(bravo.corrected, bravo.true))
    assert corrected_m < 60  # two sigma of the place
    assert reported_m > 600
    noise_m = 3 * 0.3 / 57.3 * 20_000  # three sigma of a bearing at the far end
    assert median_to_truth_m(drawn, bravo.corrected_logs) < noise_m
    assert median_to_truth_m(drawn, bravo.reported_logs) > 3 * noise_m
    assert median_to_truth_m(drawn, drawn.carriers[0].reported_logs) < noise_m


def test_logs_are_drawn_corrected_only_while_a_correction_is_applied(
    story: Story, drawn: Scene
) -> None:
    (series,) = frame_series(story)
    applied = [(s.from_s, s.to_s) for s in series.states if s.name == "applied"]
    slack_s = 0.1  # of the clocks
    for t_s in drawn.carriers[1].corrected_logs.t_s:
        assert any(start - slack_s <= t_s <= end + slack_s for start, end in applied)


def test_ellipses_hold_the_truth_about_as_often_as_they_say(drawn: Scene) -> None:
    bravo = drawn.carriers[1]
    inside = 0
    for ellipse in bravo.ellipses:
        nearest = np.nanargmin(np.abs(bravo.true.t_s - ellipse.t_s))
        error = bravo.true.east_north_m[nearest] - ellipse.east_north_m
        cos, sin = np.cos(ellipse.angle_rad), np.sin(ellipse.angle_rad)
        along = np.array([[cos, sin], [-sin, cos]]) @ error
        slack_m = 10.0  # the truth is of another instant of the second
        inside += bool(np.sum((along / (ellipse.axes_m / 2 + slack_m)) ** 2) <= 1)
    assert len(bravo.ellipses) >= 5
    assert inside >= 0.6 * len(bravo.ellipses)


def test_page_needs_nothing_from_outside(whole: Path) -> None:
    _, page = written(whole)
    of_ours = page.replace(_bokeh_of(page), "")
    assert LOADS.search(of_ours) is None
    assert "default-src 'none'" in page
    assert len(page) < MAX_BYTES


def test_without_truth_it_says_so_and_shows_what_is_claimed(blind: Path) -> None:
    figures, page = written(blind)
    assert not figures.has_truth
    assert "No truth is recorded" in page
    assert "moved and turned by the last correction" in page
    assert "Is the claimed sigma honest?" not in page
    (bravo,) = figures.carriers
    assert bravo.truth is None
    assert bravo.moved_m == pytest.approx(2500, rel=0.1)  # its navigation error by this seed


def test_a_killed_recording_is_shown_as_far_as_it_goes(folder: Path, whole: Path) -> None:
    figures, page = written(recordings.torn(whole, folder / "torn.mcap"))
    assert "The recording has no end" in page
    assert 0 < figures.steps < figures.steps_declared
    assert f"{figures.steps} of {figures.steps_declared} steps" in page


def test_damage_in_the_middle_is_said_and_what_lies_before_is_shown(
    folder: Path, whole: Path
) -> None:
    damaged = recordings.damaged(whole, folder / "damaged.mcap")
    figures, page = written(damaged)
    assert "Reading ended early" in page
    assert 0 < figures.steps < figures.steps_declared


def test_a_recording_without_corrections(folder: Path, whole: Path) -> None:
    path = recordings.without(whole, folder / "uncorrected.mcap", keys.CORRECTION)
    figures, page = written(path)
    assert figures.carriers == []
    assert "No correction was found" in page


def test_a_recording_in_which_nothing_was_said(folder: Path) -> None:
    figures, page = written(recordings.bare(folder))
    assert figures.messages == figures.steps == 0
    assert "Nothing in this recording has a place" in page


def test_a_thousand_targets_stay_a_small_page(folder: Path) -> None:
    figures, page = written(recordings.crowded(folder))
    assert len(page) < MAX_BYTES
    assert any("of the busiest source is drawn" in text for text in figures.sampling)
    assert "1000 true targets" in page


def test_a_carrier_of_which_no_truth_is_known_is_shown_without_errors(
    folder: Path, whole: Path
) -> None:
    figures, page = written(recordings.with_stranger(whole, folder / "stranger.mcap"))
    stranger = next(c for c in figures.carriers if c.name == "stranger")
    assert stranger.truth is None
    assert "stranger" in page


def test_names_of_others_stay_text(hostile: Path) -> None:
    _, page = written(hostile)
    assert recordings.HOSTILE not in page
    assert "<img" not in page.replace(_bokeh_of(page), "")


def test_json_are_the_figures(whole: Path, crossfix: Crossfix) -> None:
    shown = crossfix("report", whole, "--json")
    figures = json.loads(shown.out)
    assert figures["run"] == "small"
    assert figures["has_truth"] is True
    assert figures["carriers"][0]["truth"]["after_m"] < figures["carriers"][0]["truth"]["before_m"]
    assert figures["losses"]["totals"]["received"] > 0


def test_markdown_has_a_whole_table_and_no_markup_of_others(
    hostile: Path, whole: Path, crossfix: Crossfix
) -> None:
    shown = crossfix("report", whole, "--md").out
    rows = [line for line in shown.splitlines() if line.startswith("| bravo | place")]
    assert len(rows) == 1
    assert rows[0].count("|") == 8
    names = crossfix("report", hostile, "--md").out
    assert "\\<img" in names
    assert "<img" not in names.replace("\\<img", "")
    assert len([line for line in shown.splitlines() if line.startswith("| targets | tracks")]) == 1


def test_page_goes_beside_the_recording_and_says_where(whole: Path, crossfix: Crossfix) -> None:
    page = whole.with_suffix(".html")
    page.unlink(missing_ok=True)
    assert crossfix("report", whole).out == f"report: {page}\n"
    assert page.exists()


@pytest.mark.parametrize(("form", "code"), [((), 2), (("--json",), 0), (("--md",), 0)])
def test_only_the_page_needs_bokeh(
    form: tuple[str, ...], code: int, whole: Path, crossfix: Crossfix,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr("crossfix.report.find_spec", lambda name: None)
    shown = crossfix("report", whole, *form)
    assert shown.code == code
    assert ("pip install 'crossfix[view]'" in shown.err) == (code != 0)


def test_a_run_that_is_to_be_drawn_needs_bokeh_before_it_starts(
    tmp_path: Path, crossfix: Crossfix, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crossfix.report.find_spec", lambda name: None)
    output = tmp_path / "run.mcap"
    shown = crossfix("run", recordings.SMALL, "--report", "-o", output)
    assert shown.code == 2
    assert "pip install 'crossfix[view]'" in shown.err
    assert not output.exists()


@pytest.mark.live
def test_a_run_draws_its_recording_and_says_where(tmp_path: Path, hub: str) -> None:
    output = tmp_path / "run.mcap"
    command = [sys.executable, "-m", "crossfix", "run", str(recordings.SMALL)]
    done = subprocess.run(
        [*command, "--connect", hub, "--report", "-o", str(output)],
        capture_output=True, text=True, timeout=DEADLINE_S, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    page = output.with_suffix(".html")
    assert f"report: {page}" in done.stderr.replace("\n", "")
    assert "Tactical picture" in page.read_text(encoding="utf-8")


def test_a_recording_is_never_overwritten_by_its_report(whole: Path, crossfix: Crossfix) -> None:
    before = whole.read_bytes()
    shown = crossfix("report", whole, "-o", whole)
    assert shown.code == 2
    assert "overwrite" in shown.err
    assert whole.read_bytes() == before


def test_a_page_that_cannot_be_written_is_one_line(
    folder: Path, whole: Path, crossfix: Crossfix
) -> None:
    shown = crossfix("report", whole, "-o", folder / "nowhere" / "report.html")
    assert shown.code == 2
    assert shown.err.startswith("error: ")
    assert "no such folder" in shown.err


@pytest.mark.parametrize(
    ("page", "reason"), [("nowhere/report.html", "no such folder"), (".", "Is a directory")]
)
def test_a_page_that_cannot_be_written_is_found_before_the_recording_is_read(
    page: str, reason: str, tmp_path: Path, crossfix: Crossfix
) -> None:
    unreadable = tmp_path / "long.mcap"
    unreadable.write_bytes(b"no recording")
    shown = crossfix("report", unreadable, "-o", tmp_path / page)
    assert shown.code == 2
    assert reason in shown.err
    assert len(shown.err.splitlines()) == 1


@given(st.lists(st.integers(0, 50), max_size=200), st.integers(50, 500))
def test_thinned_is_bounded_even_and_begins_with_the_first(weights: list[int], limit: int) -> None:
    thinned = Thinned[int](limit)
    for number, weight in enumerate(weights):
        if thinned.wants_next():
            thinned.keep(number, weight)
    kept = list(thinned)
    assert kept == list(range(len(weights)))[:: thinned.every]
    assert sum(weights[n] for n in kept) <= limit
    if thinned.every > 1:  # half as thin would have been too much
        assert sum(weights[:: thinned.every // 2]) > limit


@given(st.integers(0, 10_000), st.integers(1, 500))
def test_stride_leaves_at_most_the_limit_and_the_first(count: int, limit: int) -> None:
    left = range(count)[stride(count, limit)]
    assert len(left) <= limit
    assert count == 0 or left[0] == 0


def distance_m(track: Track, true: Track) -> Array:
    """From each point of a track to where it should have been."""
    known = np.isfinite(true.t_s)
    should = [np.interp(track.t_s, true.t_s[known], true.east_north_m[known, i]) for i in (0, 1)]
    return np.hypot(*(track.east_north_m - np.array(should).T).T)


def median_to_truth_m(drawn: Scene, logs) -> float:
    return float(np.median(np.concatenate([*distances_m(drawn, logs)])))


def distances_m(drawn: Scene, logs) -> Iterator[Array]:
    """From the logs of each target to its track."""
    for target in drawn.targets:
        mine = np.array([drawn.names[n] == target.name for n in logs.name])
        if mine.any():
            yield distance_m(Track(logs.t_s[mine], logs.east_north_m[mine]), target.track)


def _bokeh_of(page: str) -> str:
    """The library within the page."""
    return max(re.findall(r"<script[^>]*>.*?</script>", page, re.DOTALL), key=len)
