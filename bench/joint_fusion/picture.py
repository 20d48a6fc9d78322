"""A whole run of ships in company: who is who in the picture, with features and without.

The scenario is `scenarios/features.toml`. Its radars are made to read every identity, which is
taken out of the reports before the fusion centre gets them: so the truth of each log is known.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace

from bench.figures import Figure, at_least, at_most, told
from bench.in_process import Played, played
from crossfix.evaluation import picture_errors
from estimation.metrics import identity_changes
from schemas.messages import Input, Navigation, Quality, SourceReport, Tracks
from sim_world.scenario import Scenario, load_scenario, with_overrides

SCENARIO = Path(__file__).parents[2] / "scenarios" / "features.toml"
WAYS: dict[str, dict[str, Any]] = {
    "without features": {"enabled": False},
    "as declared": {"learn": False},
    "learned": {},
}
SETTLED = 60
"""Steps after which a picture is judged."""
CLEAR_M = 100.0
"""From all others, for a target to be matched surely."""
RUNS_EACH = 500
"""Of the pairs of this bench, to one run of the scenario."""


class Judged(NamedTuple):
    """Of a run, from `SETTLED` on.

    Attributes:
        changes: targets held by another track than the last that held them, both times clear of
            all other targets: on top of each other nobody is matched with more than chance.
        wrong: share of the logs in tracks that are of another target than most of their track.
        gospa_m: mean; missed, false: mean numbers.
        applied_s: when the other frame was first used; the whole run if never.
        factor: learned over declared sigma of the lengths, by carrier.
    """

    changes: int
    wrong: float
    gospa_m: float
    missed: float
    false: float
    applied_s: float
    factor: dict[str, float]


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Every way on the same seeds; nothing where there are too few runs for one."""
    seeds = range(seed, seed + runs // RUNS_EACH)
    if not seeds:
        return
    found = {name: [judged(run(one, way)) for one in seeds] for name, way in WAYS.items()}
    blind, best = found["without features"], found["learned"]
    for name, every in found.items():
        wrong = float(np.mean([one.wrong for one in every]))
        changes = float(np.mean([one.changes for one in every]))
        yield told(f"ships in company, {name}: logs in a wrong track", wrong)
        yield told(f"ships in company, {name}: identity changes", changes)
        yield told(f"ships in company, {name}: GOSPA", _mean(every, "gospa_m"), "m")
        yield told(f"ships in company, {name}: missed", _mean(every, "missed"))
        yield told(f"ships in company, {name}: false", _mean(every, "false"))
        yield told(f"ships in company, {name}: frame used after", _mean(every, "applied_s"), "s")
    better = _mean(best, "wrong") / max(_mean(blind, "wrong"), 1e-9)
    yield at_most("ships in company: logs in a wrong track, learned / without", better, 0.5)
    gospa = _mean(best, "gospa_m") / _mean(blind, "gospa_m")
    yield at_most("ships in company: GOSPA, learned / without", gospa, 1.0)
    factor = float(np.mean([one.factor.get("other", 1.0) for one in best]))
    yield at_least("ships in company: sigma found / declared, true 3", factor, 2.5)
    yield at_most("ships in company: sigma found / declared, true 3", factor, 3.5)


def run(
    seed: int, way: Mapping[str, Any], steps: int | None = None
) -> tuple[Scenario, list[Played]]:
    """The scenario with a seed and with other settings of `features`."""
    scenario = load_scenario(SCENARIO)
    readable = {
        f"carriers.{carrier.name}.sensors.{sensor.name}.identity_share": 1.0
        for carrier in scenario.file.carriers
        for sensor in carrier.sensors
    }
    scenario = with_overrides(scenario, {"seed": seed, **readable})
    fusion = {**scenario.declared.fusion, "features": dict(way)}
    return scenario, list(played(scenario, fusion, steps, nameless))


def nameless(message: Input) -> Input:
    """A report without the identities in it."""
    if not isinstance(message, SourceReport):
        return message
    return replace(message, identity=None, identity_kind=None)


def judged(made: tuple[Scenario, list[Played]]) -> Judged:
    """How good the pictures of a run were."""
    scenario, steps = made
    own = scenario.declared.carriers[0].name
    messages: list[Any] = []
    for step in steps:
        messages += [step.targets, step.carriers]
        messages += [m for m in step.said if isinstance(m, Navigation)]
        messages += [out.message for out in step.outputs if isinstance(out.message, Tracks)]
    errors = picture_errors(scenario.declared, own, messages)[SETTLED:]
    clear = {step.closed.step: _clear(step) for step in steps}
    pairs = [
        (e.step, target, track)
        for e in errors
        for target, track in e.pairs
        if target in clear[e.step]
    ]
    at, target, track = (np.array(column) for column in zip(*pairs, strict=True))
    names = np.unique(track, return_inverse=True)[1]
    return Judged(
        changes=identity_changes(at, target, names),
        wrong=wrong_share(steps),
        gospa_m=float(np.mean([e.gospa_m for e in errors])),
        missed=float(np.mean([e.missed for e in errors])),
        false=float(np.mean([e.false for e in errors])),
        applied_s=_applied_s(steps),
        factor=_factors(steps),
    )


def _clear(step: Played) -> set[int]:
    """Targets that no other is near."""
    place = np.array(step.targets.position_m)[:, :2]
    apart = np.hypot(*np.moveaxis(place[:, None] - place, -1, 0)) + np.diag([np.inf] * len(place))
    return {n for n, d in zip(step.targets.number, apart.min(axis=1), strict=True) if d > CLEAR_M}


def wrong_share(steps: Iterable[Played]) -> float:
    """Share of the logs in tracks that are of another target than most of their track's."""
    truth: dict[str, str] = {}
    taken: dict[str, dict[str, str]] = {}
    for number, step in enumerate(steps):
        for report in step.said:
            if isinstance(report, SourceReport):
                for index, name in enumerate(report.identity or ()):
                    log = f"{report.carrier}/1/{report.stream}/{report.seq}/{index}"
                    truth[log] = name or "nobody"
        if number < SETTLED:
            continue
        for out in step.outputs:
            if isinstance(out.message, Tracks):
                for shown in out.message.tracks:
                    logs = taken.setdefault(shown.id, {})
                    logs.update({log: truth[log] for log in shown.logs if log in truth})
    counts = [Counter(logs.values()) for logs in taken.values() if logs]
    total = sum(sum(count.values()) for count in counts)
    return 1.0 - sum(max(count.values()) for count in counts) / max(total, 1)


def _applied_s(steps: list[Played]) -> float:
    states = ([c.state for c in step.corrections.values()] for step in steps)
    return float(next((n for n, s in enumerate(states, 1) if "applied" in s), len(steps)))


def _factors(steps: list[Played]) -> dict[str, float]:
    """As told last of each carrier."""
    every = (out.message for step in steps for out in step.outputs)
    return {
        source.carrier: how.learned_sigma / how.declared_sigma
        for quality in every
        if isinstance(quality, Quality)
        for source in quality.sources
        for name, how in source.features.items()
        if name == "length_m" and how.declared_sigma
    }


def _mean(every: list[Judged], name: str) -> float:
    return float(np.mean([getattr(one, name) for one in every]))
