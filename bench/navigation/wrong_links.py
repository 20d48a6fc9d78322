"""One link wrong from its first range on, in scenario `group`: when it is found, and what it costs.

    python -m bench.navigation.wrong_links [--seed N] [--runs N] [--json]

Each run has another link and another error, in turn, and is played once more with none: whole runs
in process, 200 s each, some 10 s of one core. Any link but the wrong one that is released is one
too many.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from msgspec.structs import replace

from bench.figures import Figure, options, report, told
from bench.in_process import played
from bench.navigation.live import SCENARIOS, errors
from estimation.consistency import rms
from estimation.joint_navigation.links import errors as released
from estimation.joint_navigation.online_rows import LINK
from fusion_center.group.joining import joint_of
from schemas.messages import Input, Ranging
from sim_world.scenario import Scenario, load_scenario, with_overrides

LOOKED_AT_S = (20, 60, 100, 200)


class Wrong(NamedTuple):
    """A link, and by how much its ranges are too long."""

    carrier: str
    peer: str
    error_m: float

    def __str__(self) -> str:
        return f"{self.carrier} to {self.peer} {self.error_m:+g} m"

    def of(self, message: Input) -> Input:
        """The message as it is said."""
        if isinstance(message, Ranging) and (message.carrier, message.peer) == self[:2]:
            return replace(message, value_m=message.value_m + self.error_m)
        return message

    def is_of(self, name: str) -> bool:
        """Whether a link, named by its block, is this one."""
        ends = name.removeprefix(LINK).split("|")[:2]
        return [end.partition("/")[2] for end in ends] == [self.carrier, self.peer]


WRONG = (
    Wrong("one", "two", 100.0),
    Wrong("two", "mark", 100.0),
    Wrong("one", "three", 40.0),
    Wrong("three", "mark", -150.0),
    Wrong("two", "three", 100.0),
)
NONE = Wrong("", "", 0.0)


def measured(seed: int, runs: int) -> Iterator[Figure]:
    """With an error and with none."""
    group = load_scenario(SCENARIOS / "group.toml")
    for i in range(runs):
        scenario = with_overrides(group, {"seed": seed + i})
        for wrong in (WRONG[i % len(WRONG)], NONE):
            yield from _run(scenario, wrong, f"{seed + i}, {wrong if any(wrong) else 'none'}")


def _run(scenario: Scenario, wrong: Wrong, name: str) -> Iterator[Figure]:
    first_s, others, found = 0, 0, {}
    for step in played(scenario, steps=LOOKED_AT_S[-1], heard=wrong.of):
        found = released(joint_of(step.state.group)) if step.state.group else {}
        if found and not first_s:
            first_s, others = step.closed.step, sum(not wrong.is_of(link) for link in found)
        if step.closed.step in LOOKED_AT_S:
            now = errors(step)
            at = f"{name}: after {step.closed.step} s"
            yield told(f"{at}, NEES by dimension", now.nees)
            yield told(f"{at}, relative position, per axis", float(rms(now.relative_m)), "m")
    yield told(f"{name}: released after", first_s, "s")
    yield told(f"{name}: released with it or instead", others)
    for link, (error_m, sigma_m) in found.items():
        if wrong.is_of(link):
            yield told(f"{name}: found", error_m, "m")
            yield told(f"{name}: sigma of that", sigma_m, "m")


def main() -> None:
    """Measure, print."""
    given = options("Links that are wrong from their first range on.", runs=5)
    report(measured(given.seed, given.runs), given)


if __name__ == "__main__":
    main()
