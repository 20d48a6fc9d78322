"""The shipped scenarios show what they promise: enough common targets, all within reach."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from carriers.carrier import Carrier, Stamp
from schemas.messages import SourceReport
from sim_world.navigation import frame_error
from sim_world.scenario import Scenario, load_scenario, with_overrides
from sim_world.world import World

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data" / "real"
EVERY = 20


def common(scenario: Scenario) -> dict[tuple[str, str], list[int]]:
    """How many identities each pair of carriers reads at the same step, now and then."""
    world = World(scenario)
    names = [c.name for c in scenario.declared.carriers]
    carriers = {name: (Carrier(scenario, name), Stamp("b")) for name in names}
    counts: dict[tuple[str, str], list[int]] = {pair: [] for pair in combinations(names, 2)}
    for step in range(1, scenario.declared.steps + 1, EVERY):
        truth, read = world.step(step), {}
        for name, (carrier, stamp) in carriers.items():
            said = [m for _, _, m in carrier.step(*truth, stamp) if isinstance(m, SourceReport)]
            read[name] = {identity for m in said for identity in m.identity or () if identity}
        for pair, count in counts.items():
            count.append(len(read[pair[0]] & read[pair[1]]))
    return counts


def test_the_strait_is_as_lively_as_it_says() -> None:
    scenario = load_scenario(ROOT / "scenarios" / "strait.toml")
    assert (scenario.declared.steps, scenario.declared.step_ns) == (600, 10**9)
    assert len(scenario.declared.carriers) == 3
    targets = scenario.file.targets
    assert len(targets) == 20
    assert sum(bool(t.identity) for t in targets) == 16
    assert len({type(t.motion) for t in targets}) == 4
    assert len({t.class_name for t in targets}) == 7
    for pair, count in common(scenario).items():
        assert np.percentile(count, 10) >= 7, pair


def test_the_papers_experiment_has_the_papers_sigmas() -> None:
    scenario = load_scenario(ROOT / "scenarios" / "paper000.toml")
    own, other = scenario.declared.carriers
    assert np.hypot(own.sigma_position_m, other.sigma_position_m) == 1500
    assert own.sigma_north_rad == other.sigma_north_rad == np.radians(1)
    for carrier in (own, other):
        source = carrier.sources["radar"]
        assert (source.sigma_range_m, source.sigma_bearing_rad) == (100, np.radians(0.5))
    more = with_overrides(scenario, {"target_groups.common.count": 50})
    assert set(common(more)["own", "other"]) == {50}
    assert not frame_error(scenario.file, scenario.file.carriers[0]).position_m.any()
    place = np.array(World(more).step(0)[0].position_m)[:, :2]
    assert np.abs(place).max() < 15_000


@pytest.mark.skipif(not DATA.is_dir(), reason="no shared data here")
def test_the_solent_shows_the_real_ships() -> None:
    scenario = load_scenario(ROOT / "scenarios" / "solent.toml", data=DATA)
    world = World(scenario)
    seen = [set(world.step(k)[0].identity) for k in (1, 450, 900)]
    assert all(len(ships) >= 60 for ships in seen)
    assert all(len(mmsi) == 9 and mmsi.isdecimal() for ships in seen for mmsi in ships)
    speed = np.linalg.norm(world.step(450)[0].velocity_mps, axis=1)
    assert np.sum(speed > 2) >= 8
    assert speed.max() < 25
    shares = {f"carriers.{c.name}.sensors.radar.identity_share": 1 for c in scenario.file.carriers}
    for pair, count in common(with_overrides(scenario, {**shares, "time.duration_s": 100})).items():
        assert min(count) >= 20, pair
