"""A carrier that uses its corrections: the same bytes whatever the bus does, nothing twice."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from crossfix.evaluation import true_frame
from crossfix.evaluation.recordings import frame_summaries
from crossfix.report.axes import Axes
from crossfix.report.figures import figures_of
from crossfix.report.logs import Names, logs_of
from crossfix.report.series import frame_series
from crossfix.report.story import read_story
from estimation.consistency import nees
from estimation.frames import Site, target_from_source, wrap_pi
from fusion_center.navigation import symmetric
from schemas import codec, keys
from schemas.bus.memory_bus import MemoryNetwork
from schemas.feedback import WINDOW
from schemas.messages import Command, Correction, Navigation, Pose, SourceReport, TruthCarriers
from sim_world.scenario import Scenario, parse_scenario, with_overrides
from sim_world.scenario.declared import origin_of
from tests.whole.in_memory import MemoryRun
from tests.whole.recorded import messages, outputs
from tests.whole.refusing import refused

SCENARIO = Path(__file__).with_name("small.toml")
STEPS = 30


@pytest.fixture(scope="module")
def plain() -> Scenario:
    return parse_scenario(SCENARIO.read_text(), SCENARIO.name)


@pytest.fixture(scope="module")
def feeding(plain: Scenario) -> Scenario:
    return with_overrides(plain, {"carriers.bravo.use_corrections": True})


def carried_out(scenario: Scenario, path: Path, **trouble: object) -> Path:
    with MemoryNetwork(1, **trouble) as network:  # type: ignore[arg-type]
        MemoryRun(scenario, network, path).carry_out()
    return path


@pytest.fixture(scope="module")
def fed(feeding: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return carried_out(feeding, tmp_path_factory.mktemp("fed") / "run.mcap")


def of_bravo(path: Path) -> list[Navigation]:
    found = messages(path, keys.NAVIGATION, Navigation)
    return [message for message in found if message.carrier == "bravo"]


def corrections(path: Path) -> dict[str, Correction]:
    return {c.id: c for c in messages(path, keys.CORRECTION, Correction)}


def test_at_every_step_the_correction_of_the_window_before_is_applied(fed: Path) -> None:
    sent, held = corrections(fed), {m.step: m.correction_id for m in of_bravo(fed)}
    assert len(held) == STEPS
    for step, name in held.items():
        before = sent.get(f"fusion/bravo/{step - WINDOW}")
        assert name == (before.id if before and before.feedback else "")
    assert sum(map(bool, held.values())) > STEPS - WINDOW - 8
    reports = messages(fed, keys.REPORT, SourceReport)
    for report in reports:
        assert report.correction_id == (held[report.step] if report.carrier == "bravo" else "")


@pytest.mark.slow
def test_lost_doubled_delayed_and_reordered_messages_change_no_byte(
    feeding: Scenario, fed: Path, tmp_path: Path
) -> None:
    trouble = {"loss": 0.2, "duplicate": 0.2, "delay_s": (0.0, 0.02), "reorder": 0.3}
    path = carried_out(feeding, tmp_path / "run.mcap", **trouble)
    assert outputs(path) == outputs(fed)
    assert said(path) == said(fed)


def said(path: Path) -> list[bytes]:
    """What bravo says, but for the boot."""
    return [codec.encode(changed) for changed in map(_without_boot, of_bravo(path))]


def _without_boot(message: Navigation) -> Navigation:
    return Navigation(**{n: getattr(message, n) for n in message.__struct_fields__} | {"boot": "x"})


def test_it_is_fused_again_to_the_same_bytes(fed: Path) -> None:
    assert refused(fed) == [(key, payload) for key, payload in outputs(fed)]


def test_the_estimates_are_those_without_feedback(
    plain: Scenario, fed: Path, tmp_path: Path
) -> None:
    without = corrections(carried_out(plain, tmp_path / "run.mcap"))
    for name, one in corrections(fed).items():
        other = without[name]
        assert (one.state, one.pairs) == (other.state, other.pairs)
        if one.own_axes and other.own_axes:
            axes, others = one.own_axes, other.own_axes
            assert [axes.east_m, axes.north_m] == pytest.approx(
                [others.east_m, others.north_m], abs=1e-6
            )
            assert axes.rotation_rad == pytest.approx(others.rotation_rad, abs=1e-12)
            assert axes.covariance == pytest.approx(others.covariance, rel=1e-9, abs=1e-12)


def errors(scenario: Scenario, path: Path) -> Iterator[tuple[Navigation, np.ndarray]]:
    """What bravo says of its place and north, less the truth, in the frame of alpha [m, rad]."""
    truths = {t.step: t for t in messages(path, keys.TRUTH_CARRIERS, TruthCarriers)}
    turned = {(r.carrier, r.step): r.turned_rad for r in messages(path, keys.REPORT, SourceReport)}
    known = messages(path, keys.NAVIGATION, Navigation)
    own = {m.step: m.pose for m in known if m.carrier == "alpha"}
    for said in of_bravo(path):
        pair, truth = (own[said.step], said.pose), truths[said.step]
        true = true_frame(origin_of(scenario.file), truth, "alpha", "bravo", pair, truth.t_ns)
        seen = target_from_source(site(pair[0]), site(pair[1])).translation_m[:2]
        too_far = turned["bravo", said.step] - float(wrap_pi(true.rotation_rad))
        yield said, np.array([*(seen - true.place_m), too_far])


def site(pose: Pose) -> Site:
    return Site(pose.latitude_rad, pose.longitude_rad, pose.altitude_m)


def test_what_it_says_of_itself_is_as_right_as_the_correction_claims(
    feeding: Scenario, fed: Path
) -> None:
    before = after = 0.0
    for message, error in errors(feeding, fed):
        if not message.correction_id:
            before = max(before, float(np.hypot(*error[:2])))
            continue
        after = max(after, float(np.hypot(*error[:2])))
        assert message.pose.covariance is not None
        sigma = np.sqrt(np.diag(symmetric(message.pose.covariance, 3)))
        assert (np.abs(error) < 5 * sigma).all()
        of_pose = np.array([error[0], error[1], -error[2]])
        assert float(nees(of_pose, symmetric(message.pose.covariance, 3))) < 25.0
    assert before > 300.0
    assert after < before / 10


def test_table_and_page_say_who_applies_its_corrections(fed: Path) -> None:
    [row] = frame_summaries(fed)
    assert 0 < row.said_m < row.before_m / 10
    story = read_story(fed)
    [figures] = figures_of(story, frame_series(story)).carriers
    assert figures.applies
    assert figures.said_m == row.said_m


def test_once_applied_logs_are_drawn_where_the_correction_puts_them(fed: Path) -> None:
    """As reported and as corrected they differ by no more than a correction changes in a window."""
    story = read_story(fed)
    said, strong = logs_of(story, Axes(story), "bravo", Names())
    late = said.t_s > STEPS / 2
    of_corrected = strong.t_s > STEPS / 2
    apart = said.east_north_m[late] - strong.east_north_m[of_corrected]
    assert np.hypot(*apart.T).max() < 100.0
    first = said.t_s < WINDOW
    count = int((strong.t_s < WINDOW).sum())
    assert count
    wrong = said.east_north_m[first][-count:] - strong.east_north_m[:count]
    assert np.hypot(*wrong.T).min() > 100.0


@pytest.mark.slow
def test_a_suspended_correction_is_dropped_again(feeding: Scenario, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"

    def suspend(run: MemoryRun) -> None:
        run.await_step(15)
        order = Command(id="1", kind="suspend", carrier="bravo")
        with run.network.bus("operator") as bus:
            encoding = codec.encoding_of(Command)
            key = keys.COMMAND.key(run.run, keys.FUSION)
            assert bus.query(key, codec.encode(order), encoding, 5.0)

    with MemoryNetwork() as network:
        run = MemoryRun(feeding, network, path)
        run.fusion_delay_s = 0.02
        run.carry_out(suspend)
    held = [bool(m.correction_id) for m in of_bravo(path)]
    assert any(held[:20])
    states = {c.step: c.state for c in corrections(path).values()}
    dropped = [step for step, state in states.items() if state == "suspended"]
    assert dropped
    for message in of_bravo(path):
        if message.step - WINDOW in dropped:
            assert (message.correction_id, message.uncorrected) == ("", None)
    assert refused(path) == outputs(path)


@pytest.mark.slow
def test_a_new_life_holds_no_correction_of_the_one_before(
    feeding: Scenario, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"

    def kill(run: MemoryRun) -> None:
        run.await_step(14)
        run.kill_carrier("bravo")
        run.start_carrier("bravo")

    with MemoryNetwork() as network:
        run = MemoryRun(with_overrides(feeding, {"time.duration_s": 45}), network, path)
        run.fusion_delay_s = 0.02
        run.carry_out(kill)
    lives: dict[str, list[Navigation]] = {}
    for message in of_bravo(path):
        lives.setdefault(message.boot, []).append(message)
    first, second = sorted(lives.values(), key=lambda life: life[0].step)
    assert first[-1].correction_id
    assert not any(m.correction_id for m in second[:WINDOW])
    assert second[-1].correction_id
    assert refused(path) == outputs(path)


@pytest.mark.slow
def test_in_a_paced_run_a_correction_is_applied_when_it_comes(
    feeding: Scenario, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    with MemoryNetwork() as network:
        MemoryRun(feeding, network, path, rate=10.0).carry_out()
    held = [m.correction_id for m in of_bravo(path) if m.correction_id]
    assert len(held) > STEPS / 3
    numbers = [int(name.rpartition("/")[2]) for name in held]
    assert numbers == sorted(numbers)
    assert refused(path) == outputs(path)


@pytest.mark.slow
def test_the_run_ends_with_its_fusion_centre(feeding: Scenario, tmp_path: Path) -> None:
    """The carrier waits for a correction that nobody will send: the world ends the run."""
    path = tmp_path / "run.mcap"

    def kill(run: MemoryRun) -> None:
        run.await_step(12)
        run.network.kill(keys.FUSION)

    with MemoryNetwork() as network:
        MemoryRun(feeding, network, path).carry_out(kill)
