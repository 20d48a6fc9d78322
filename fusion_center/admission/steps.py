"""When a step is, and which steps a run has."""

from __future__ import annotations

from schemas.messages import DeclaredScenario, Step


def instant_ns(scenario: DeclaredScenario, step: int) -> int:
    """Scenario time of a step."""
    return scenario.epoch_ns + step * scenario.step_ns


def refusal(step: Step, scenario: DeclaredScenario) -> str:
    """Why a step cannot be one of this run's; empty if it can."""
    if step.step > scenario.steps:
        return f"step {step.step} of {scenario.steps}"
    if step.t_ns != instant_ns(scenario, step.step) and not step.ended:
        return f"step {step.step} at another instant than its own"
    return ""
