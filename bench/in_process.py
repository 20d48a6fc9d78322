"""A whole run as functions: truth, carriers and fusion step by step, without a bus or a clock."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping
from typing import Any, NamedTuple

from carriers.carrier import Carrier, Stamp
from fusion_center import pipeline
from fusion_center.settings import settings_from
from fusion_center.state import State
from schemas.messages import Closed, Correction, Input, TruthCarriers, TruthTargets
from sim_world.scenario import Scenario
from sim_world.world import World


class Played(NamedTuple):
    """One step of a run."""

    closed: Closed
    said: list[Input]
    targets: TruthTargets
    carriers: TruthCarriers
    state: State
    outputs: pipeline.Outputs

    @property
    def corrections(self) -> dict[str, Correction]:
        """By carrier."""
        found = (out.message for out in self.outputs)
        return {m.carrier: m for m in found if isinstance(m, Correction)}


def played(
    scenario: Scenario,
    fusion: Mapping[str, Any] | None = None,
    steps: int | None = None,
    heard: Callable[[Input], Input] = lambda message: message,
    away: Callable[[int], Container[str]] = lambda step: (),
) -> Iterator[Played]:
    """The steps of a run, one after another.

    Args:
        fusion: settings instead of the scenario's.
        steps: instead of all.
        heard: what the fusion centre gets of a message.
        away: which carriers take no part in a step; whoever comes back does so with a new boot.
    """
    world, declared = World(scenario), scenario.declared
    carriers = [Carrier(scenario, c.name) for c in declared.carriers]
    stamps: dict[str, Stamp] = {}
    settings = settings_from(declared.fusion if fusion is None else fusion)
    state = pipeline.initial(declared, settings)
    for step in range(1, (steps or declared.steps) + 1):
        targets, truth = world.step(step)
        here = [carrier for carrier in carriers if carrier.name not in away(step)]
        lost = sorted(set(stamps) - {carrier.name for carrier in here})
        joined = [carrier.name for carrier in here if carrier.name not in stamps]
        stamps = {c.name: stamps.get(c.name) or Stamp(f"b{step}") for c in here}
        said = [
            out.message
            for carrier in here
            for out in carrier.step(targets, truth, stamps[carrier.name])
            if isinstance(out.message, Input)
        ]
        manifest = [end for name, stamp in stamps.items() for end in stamp.manifest(name)]
        closed = Closed(
            step=step, t_ns=world.t_ns(step), manifest=manifest, joined=joined, lost=lost
        )
        state, outputs = pipeline.step(state, closed, [heard(message) for message in said])
        yield Played(closed, said, targets, truth, state, outputs)
