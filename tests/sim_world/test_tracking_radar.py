"""Laws of a tracking radar: honest tracks with names that last, and their new information exact."""

import numpy as np
import pytest

from carriers.carrier import Carrier, Stamp
from estimation.consistency import nees
from estimation.frames import east_north_covariance
from estimation.relative_frame.tracks import MotionModel, TrackLog, as_plots
from estimation.relative_frame.tracks import equivalent_measurement as gained_between
from schemas.errors import ScenarioError
from schemas.messages import SourceReport
from sim_world.scenario import Scenario, with_overrides
from sim_world.tracking_radar import memory_s
from sim_world.world import World
from tests.sim_world.scenes import Tree, carrier, radar, scenario, target

NO_ERRORS: Tree = {"enabled": False}
MINUTES: Tree = {"duration_s": 300.0, "step_s": 1.0}
NOISE = 0.05


def made(report: str = "track", seed: int = 1, **keys: object) -> Scenario:
    """A carrier under way without errors of its own, two ships, every plot sure."""
    tracker = radar(tracking={"process_noise": NOISE, "report": report}, period_s=2.0, **keys)
    ships = [target("a"), target("b", east_m=-6_000.0, north_m=-4_000.0, course_deg=70.0)]
    own = carrier("own", tracker)
    return scenario([own], targets=ships, errors=NO_ERRORS, time=MINUTES, seed=seed)


def reports(of: Scenario, steps: int = 200) -> list[SourceReport]:
    world, teller, stamp = World(of), Carrier(of, "own"), Stamp("b1")
    said = [out.message for k in range(steps) for out in teller.step(*world.step(k + 1), stamp)]
    return [message for message in said if isinstance(message, SourceReport)]


def symmetric(triangle: list[float], order: int) -> np.ndarray:
    matrix = np.zeros((order, order))
    matrix[np.triu_indices(order)] = triangle
    return matrix + np.triu(matrix, 1).T


def states(report: SourceReport) -> np.ndarray:
    """(n, 4) what the tracks of a report hold."""
    columns = (report.east_m, report.north_m, report.velocity_east_mps, report.velocity_north_mps)
    return np.array(columns, dtype=float).T


def covariances(report: SourceReport) -> np.ndarray:
    return np.array([symmetric(f.covariance, 4) for f in report.filter or [] if f])


def plots_of(of: Scenario, steps: int = 200) -> list[SourceReport]:
    """The same looks of the same radar, had it sent its plots."""
    file = of.file
    keys = {"identity_share": 1.0, "period_s": 2.0, "clutter_per_scan": 0.0}
    ships = [target("a"), target("b", east_m=-6_000.0, north_m=-4_000.0, course_deg=70.0)]
    plain = scenario(
        [carrier("own", radar(**keys))],
        targets=ships,
        errors=NO_ERRORS,
        time=MINUTES,
        seed=file.seed,
    )
    return reports(plain, steps)


def test_tracks_keep_their_names_and_follow_the_identities() -> None:
    said = reports(made())
    last = said[-1]
    assert sorted(last.identity or []) == ["a", "b"]
    names = [dict(zip(r.identity or [], r.track_id or [], strict=True)) for r in said if len(r)]
    assert all(name == names[-1] for name in names)
    assert set(last.kind or []) == {"track"}


def test_a_track_is_as_wrong_as_it_says() -> None:
    errors, spreads = [], []
    for seed in range(10):
        of = made(seed=seed)
        _, own = World(of).step(200)
        targets, _ = World(of).step(200)
        last = reports(of)[-1]
        for row, identity in enumerate(last.identity or []):
            at = targets.identity.index(identity or "")
            place = np.subtract(targets.position_m[at], own.position_m[0])[:2]
            truth = np.concatenate([place, targets.velocity_mps[at][:2]])
            errors.append(states(last)[row] - truth)
            spreads.append(covariances(last)[row])
    mean = np.mean(nees(np.array(errors), np.array(spreads))) / 4
    # The ships go straight, so a filter that allows for turns is a little too careful.
    assert 0.5 < mean < 1.2, mean


def test_new_information_of_tracks_is_their_plots() -> None:
    """The carrier moves: what the centre knows of its way must be put in, then out again."""
    of = made()
    tracked, plotted = reports(of), plots_of(of)
    for number in (60, 90):
        before, now, plots = tracked[number - 1], tracked[number], plotted[number]
        dt = (now.t_ns - before.t_ns) * 1e-9
        assert [f.previous_t_ns for f in now.filter or [] if f] == [before.t_ns] * 2
        way = np.array([*_way_m(of, number), 0.0, 0.0])
        model = MotionModel(np.eye(4) + dt * np.eye(4, k=2), _noise(dt))
        for row, name in enumerate(now.track_id or []):
            then = (before.track_id or []).index(name)
            place, covariance = as_plots(
                gained_between(
                    TrackLog(states(before)[then], covariances(before)[then]),
                    TrackLog(states(now)[row] + way, covariances(now)[row]),
                    model,
                )
            )
            polar = _plot(plots, (now.identity or [])[row] or "")
            assert place - way[:2] == pytest.approx(polar[0], abs=0.5)  # level and slant range
            assert covariance == pytest.approx(polar[1], rel=1e-3, abs=1e-2)


def test_increments_are_what_the_tracks_have_gained() -> None:
    tracked, learnt = reports(made()), reports(made("increment"))
    for number in (40, 80):
        before, now, told = tracked[number - 1], tracked[number], learnt[number]
        way = np.array([*_way_m(made(), number), 0.0, 0.0])
        dt = (now.t_ns - before.t_ns) * 1e-9
        model = MotionModel(np.eye(4) + dt * np.eye(4, k=2), _noise(dt))
        gained = gained_between(
            TrackLog(states(before), covariances(before)),
            TrackLog(states(now) + way, covariances(now)),
            model,
        )
        moved = gained.vector - gained.matrix @ way
        for row, increment in enumerate(told.increment or []):
            assert increment
            assert increment.frame == "carrier"
            information = symmetric(increment.information, 4)
            assert information == pytest.approx(gained.matrix[row], rel=1e-6, abs=1e-7)
            # the true way stands for the reckoned one, which is a millimetre off
            assert increment.y == pytest.approx(moved[row].tolist(), rel=1e-6, abs=2e-3)


def test_clutter_makes_few_tracks_and_a_missed_target_keeps_its_own() -> None:
    of = made(clutter_per_scan=5.0, detection_probability=0.8)
    said = reports(of)
    false = sum((r.identity or [None] * len(r)).count(None) for r in said[20:])
    assert false < 0.02 * sum(len(r) for r in said[20:])
    for identity in ("a", "b"):
        names = {
            t
            for r in said[20:]
            for i, t in zip(r.identity or [], r.track_id or [], strict=True)
            if i == identity
        }
        assert len(names) == 1


def test_a_new_life_starts_its_tracks_anew() -> None:
    of = made()
    world, teller = World(of), Carrier(of, "own")
    stamps = [Stamp("b1")] * 30 + [Stamp("b2")] * 30
    said = [list(teller.step(*world.step(k + 1), stamp)) for k, stamp in enumerate(stamps)]
    found = [m.message for outs in said for m in outs if isinstance(m.message, SourceReport)]
    assert {name for r in found for name in r.track_id or []} == {"t1", "t2"}
    assert not len(next(r for r in found if r.boot == "b2"))


def test_the_declared_memory_grows_with_the_noise_of_the_plots() -> None:
    coarse, fine = (made(sigma_range_m=s, sigma_bearing_deg=0.01) for s in (300.0, 3.0))
    memories = [of.declared.carriers[0].sources["radar"].filter_memory_s for of in (fine, coarse)]
    assert 2.0 < memories[0] < memories[1] < 300.0
    source = made().declared.carriers[0].sources["radar"]
    assert source.sends_tracks
    assert source.coordinates == "cartesian"
    assert memory_s(source, NOISE) == pytest.approx(source.filter_memory_s)


def test_a_bearing_cannot_be_tracked() -> None:
    with pytest.raises(ScenarioError, match="tracks need ranges"):
        with_overrides(made(), {"carriers.own.sensors.radar.coordinates": "bearing"})


def _noise(dt: float) -> np.ndarray:
    block = NOISE * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return np.kron(block, np.eye(2))


def _way_m(of: Scenario, number: int) -> np.ndarray:
    """What the carrier moves between two looks; it goes straight and errs in nothing."""
    world = World(of)
    (_, before), (_, now) = world.step(2 * number), world.step(2 * number + 2)
    return np.subtract(now.position_m[0], before.position_m[0])[:2]


def _plot(report: SourceReport, identity: str) -> tuple[np.ndarray, np.ndarray]:
    row = (report.identity or []).index(identity)
    bearing, distance = (report.bearing_rad or [])[row] or 0.0, (report.range_m or [])[row] or 0.0
    place = distance * np.array([np.sin(bearing), np.cos(bearing)])
    return place, east_north_covariance(bearing, distance, np.radians(0.3), 30.0)
