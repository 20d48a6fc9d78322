"""Names beside their marks: they hide neither each other nor the lines, and the frame holds all."""

from __future__ import annotations

import numpy as np
import pytest

from crossfix.report.framing import NAMED_TARGETS, PLOT_PX, Frame, frame_of, labels_of
from crossfix.report.labels import Box, Mark, Side, _candidates, sides
from crossfix.report.logs import Logs
from crossfix.report.tracks import CarrierPicture, Scene, Track, TrueTarget
from estimation.arrays import Array

NOTHING = np.zeros((0, 2))
RIGHT_ABOVE = Side(8, -5, "left")
NONE = Logs(np.zeros(0), NOTHING, np.zeros(0, int))


def box_of(mark: Mark, side: Side) -> Box:
    return dict(_candidates(mark))[side]


def test_a_name_alone_stands_right_above_its_mark() -> None:
    mark = Mark(0, 0, "alone", 10)
    assert sides([mark], NOTHING) == {mark: RIGHT_ABOVE}
    box = box_of(mark, RIGHT_ABOVE)
    assert box.left > 0
    assert box.bottom < 0


def test_a_name_leaves_a_line_free() -> None:
    mark = Mark(0, 0, "ship", 10)
    up_right = np.linspace((0, 0), (60, -30), 50)
    box = box_of(mark, sides([mark], up_right)[mark])
    assert box.holds(up_right) == 0


def test_a_name_stands_on_no_other_mark() -> None:
    mark, beside = Mark(0, 0, "ship", 10), Mark(15, -10, "x", 10)
    box = box_of(mark, sides([mark, beside], NOTHING)[mark])
    assert not box.overlaps(Box(13, -12, 17, -8))


def test_two_marks_in_one_place_have_both_names_to_be_read() -> None:
    marks = [Mark(0, 0, "one", 13), Mark(1, 1, "other", 13)]
    chosen = sides(marks, NOTHING)
    first, second = (box_of(mark, chosen[mark]) for mark in marks)
    assert not first.overlaps(second)


def test_a_name_is_not_cut_off_at_the_edge_of_the_picture() -> None:
    shown = Box(-100, -100, 100, 100)
    for x, y in ((95, 0), (-95, 0), (95, 95), (-95, -95)):
        mark = Mark(x, y, "ship", 10)
        assert box_of(mark, sides([mark], NOTHING, shown)[mark]).within(shown)


# the frame


def track(*points: tuple[float, float]) -> Track:
    return Track(np.arange(float(len(points))), np.reshape(np.array(points, float), (-1, 2)))


def carrier(name: str, *points: tuple[float, float], logs: Array = NOTHING) -> CarrierPicture:
    seen = Logs(np.zeros(len(logs)), logs, np.zeros(len(logs), int))
    return CarrierPicture(name, track(*points), track(), track(), seen, NONE, [])


def targets(number: int, at: tuple[float, float]) -> list[TrueTarget]:
    return [TrueTarget(f"t{n}", "", track(at, at)) for n in range(number)]


def test_the_frame_holds_every_carrier_and_every_target_of_a_few() -> None:
    scene = Scene([carrier("own", (0, 0), (100, 50))], targets(1, (-400, 900)), (), ())
    assert frame_of(scene).corners_m.tolist() == [[-400, 0], [100, 900]]


def test_one_of_many_ships_at_the_horizon_does_not_shrink_the_others() -> None:
    many = [*targets(2 * NAMED_TARGETS, (1000, 1000)), *targets(1, (90_000, 0))]
    scene = Scene([carrier("own", (0, 0), (10, 0))], many, (), ())
    assert frame_of(scene).corners_m.tolist() == [[0, 0], [1000, 1000]]
    assert labels_of(scene, "own", frame_of(scene)).targets == []


def test_without_truth_most_logs_are_in_it() -> None:
    logs = np.vstack([np.full((200, 2), 700.0), [[1e6, 1e6]]])
    scene = Scene([carrier("own", (0, 0), (10, 0), logs=logs)], [], (), ())
    assert frame_of(scene).corners_m.tolist() == [[0, 0], [700, 700]]


@pytest.mark.parametrize("scene", [Scene([], [], (), ()), Scene([carrier("own")], [], (), ())])
def test_nothing_known_is_an_empty_frame_and_no_names(scene: Scene) -> None:
    frame = frame_of(scene)
    assert frame.corners_m.shape == (2, 2)
    assert labels_of(scene, "own", frame).carriers == {}


def test_the_screen_has_one_scale_north_up_and_room_for_all() -> None:
    frame = Frame(np.array([[-1000.0, 0.0], [3000.0, 1000.0]]))
    middle, east, north = frame.on_screen(np.array([[1000.0, 500], [3000, 500], [1000, 1000]]))
    assert middle.tolist() == [0, 0]
    assert east[0] == pytest.approx(4 * -north[1])
    assert 0 < east[0] < PLOT_PX[0] / 2


def test_a_carrier_has_its_name_where_it_is_and_where_it_reports_to_be() -> None:
    other = carrier("other", (500, 500))._replace(corrected=track((600, 500)))
    scene = Scene([carrier("own", (0, 0)), other], [], (), ())
    labels = labels_of(scene, "own", frame_of(scene))
    assert set(labels.carriers) == {"own", "other", "other, reported"}
