"""What tracking sources say anew: exact plots, each once; whole tracks only far apart."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace

from carriers.carrier import Carrier, Stamp
from estimation.arrays import Array
from fusion_center import navigation
from fusion_center.sources.coordinates import Observer, instants_ns, places
from fusion_center.sources.news import NOTHING_TOLD, News, has_tracks, news
from fusion_center.state import Told
from schemas.messages import Navigation, SourceProperties, SourceReport
from sim_world.world import World
from tests.sim_world.test_tracking_radar import made

MEMORY_S = 10.0
SOURCE = SourceProperties(filter_memory_s=MEMORY_S)
STEPS = 90


class Said(NamedTuple):
    """A report, and what the carrier had said of its way by then."""

    report: SourceReport
    way: tuple[Navigation, ...]


@cache
def said(kind: str) -> tuple[Said, ...]:
    """The reports of a carrier under way, whose radar tracks two ships."""
    world, teller, stamp = World(made(kind)), Carrier(made(kind), "own"), Stamp("b1")
    way: tuple[Navigation, ...] = ()
    found = []
    for step in range(1, STEPS + 1):
        for out in teller.step(*world.step(step), stamp):
            if isinstance(out.message, Navigation):
                way = navigation.with_message(way, out.message)
            elif isinstance(out.message, SourceReport):
                found.append(Said(out.message, way))
    return tuple(found)


def heard(told: Said, before: Told = NOTHING_TOLD) -> News:
    report, way = told
    at_ns, here = instants_ns(report), navigation.way_m(way, report.t_ns)
    moved = navigation.way_m(way, at_ns) - here
    observer = Observer(navigation.site(navigation.pose_at(way, report.t_ns)), moved)
    found = places(report, SourceProperties(), observer, 0.0)
    return news(before, report, SOURCE, found, moved + here)


def heard_all(reports: tuple[Said, ...]) -> list[News]:
    memory, found = NOTHING_TOLD, []
    for told in reports:
        found.append(heard(told, memory))
        memory = found[-1].told
    return found


def used(found: News) -> int:
    return int(found.found.usable.sum())


def unfiltered(reports: tuple[Said, ...]) -> tuple[Said, ...]:
    return tuple(told._replace(report=replace(told.report, filter=None)) for told in reports)


def usable(found: News) -> tuple[Array, Array]:
    which = found.found.usable
    return found.found.east_north_m[which], found.found.covariance[which]


def test_increments_and_filters_say_the_same() -> None:
    pairs = [*zip(heard_all(said("increment")), heard_all(said("track")), strict=True)]
    assert sum(used(one) for one, _ in pairs) > STEPS / 2
    for one, other in pairs:
        assert used(one) == used(other) == len(one.found.altitude_m)
        for mine, theirs in zip(usable(one), usable(other), strict=True):
            assert mine == pytest.approx(theirs, rel=1e-4, abs=0.1)


@pytest.mark.parametrize("kind", ["increment", "track"])
def test_nothing_counts_twice(kind: str) -> None:
    reports = [told for told in said(kind) if len(told.report)]
    memory = heard(reports[0]).told
    assert used(heard(reports[0], memory)) == 0
    later = heard(reports[1], memory).told
    assert used(heard(reports[1], memory)) == len(reports[1].report)
    assert used(heard(reports[0], later)) == 0
    assert heard(reports[0], later).told.t_ns.tolist() == later.t_ns.tolist()


def test_after_a_missing_report_a_track_is_exact_again_at_the_next() -> None:
    first, _, third, fourth = [told for told in said("track") if len(told.report)][:4]
    gap = heard(third, heard(first).told)
    plain = heard(unfiltered((third,))[0], heard(first).told)
    assert np.array_equal(gap.found.covariance, plain.found.covariance)  # taken whole, widened
    again = heard(fourth, gap.told)
    assert again.found.covariance == pytest.approx(
        heard(fourth, heard(third).told).found.covariance
    )


def test_whole_tracks_say_no_more_than_their_memory_lets_them() -> None:
    """Of T seconds as much as of 1 + T / 2 memories independent looks, but for the steps' size."""
    reports = tuple(told for told in unfiltered(said("track")) if len(told.report))
    looks, seconds = 0.0, (reports[-1].report.t_ns - reports[0].report.t_ns) * 1e-9
    memory = NOTHING_TOLD
    for told in reports:
        found = heard(told, memory)
        memory = found.told
        row = (told.report.track_id or []).index("t1")
        stated = (told.report.covariance_position or [])[row]
        assert stated is not None
        looks += stated[0] / found.found.covariance[row, 0, 0]
    assert looks == pytest.approx(1 + seconds / (2 * MEMORY_S), rel=0.02)


def test_what_cannot_be_a_plot_is_none() -> None:
    """A matrix that is no information, axes nobody knows, a track without a name."""
    told = next(told for told in said("increment") if len(told.report))
    sent = (told.report.increment or [])[0]
    assert sent is not None
    for wrong in (
        replace(sent, information=[-v for v in sent.information]),
        replace(sent, frame="ecef"),
        None,
    ):
        increments = [wrong] * len(told.report)
        assert used(heard(told._replace(report=replace(told.report, increment=increments)))) == 0
    track = next(told for told in unfiltered(said("track")) if len(told.report))
    nameless = replace(track.report, track_id=None, identity=None)
    assert used(heard(track._replace(report=nameless))) == 0


def test_memory_forgets_tracks_that_are_silent() -> None:
    told = next(told for told in said("track") if len(told.report))
    memory = heard(told).told
    hour_ns = 3_600_000_000_000
    later = replace(told.report, t_ns=told.report.t_ns + hour_ns, track_id=["new", "newer"])
    assert set(heard(told._replace(report=later), memory).told.names) == {"new", "newer"}


def test_plots_are_no_tracks() -> None:
    unsaid = replace(said("track")[-1].report, kind=None)
    assert has_tracks(said("track")[-1].report, SOURCE)
    assert has_tracks(said("increment")[-1].report, SOURCE)
    assert not has_tracks(unsaid, SOURCE)
    assert has_tracks(unsaid, replace(SOURCE, sends_tracks=True))
