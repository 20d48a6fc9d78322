"""The time of a run, as a bridge reckons it from the steps."""

from __future__ import annotations

from typing import Any

from carriers.bridges.run_clock import RunClock
from schemas.messages import Step
from tests.carriers.bridges.outlets import NOW_NS, SECOND


class Wall:
    now_ns = 5_000 * SECOND

    def __call__(self) -> int:
        return self.now_ns


def step(number: int, mode: Any = "paced", boot: str = "w") -> Step:
    return Step(boot=boot, step=number, t_ns=NOW_NS + number * SECOND, mode=mode)


def test_without_a_run_it_is_the_wall_clock_and_before_the_first_step_the_epoch() -> None:
    wall = Wall()
    assert RunClock(None, wall).now_ns() == wall.now_ns
    assert RunClock(NOW_NS, wall).now_ns() == NOW_NS


def test_between_paced_steps_it_goes_on_at_their_rate_but_never_past_the_next() -> None:
    wall = Wall()
    clock = RunClock(NOW_NS, wall)
    clock.hear(step(1))
    wall.now_ns += SECOND // 10
    clock.hear(step(2))
    assert clock.now_ns() == NOW_NS + 2 * SECOND
    wall.now_ns += SECOND // 20
    assert abs(clock.now_ns() - NOW_NS - 2.5 * SECOND) < 1000
    wall.now_ns += 60 * SECOND
    assert clock.now_ns() == NOW_NS + 3 * SECOND
    clock.hear(step(2))  # the world repeats itself
    assert clock.now_ns() == NOW_NS + 3 * SECOND


def test_after_a_step_that_was_not_heard_and_in_lock_step_it_stands_at_the_step() -> None:
    wall = Wall()
    for numbers, mode in (((1, 3), "paced"), ((1, 2), "lockstep")):
        clock = RunClock(NOW_NS, wall)
        for number in numbers:
            clock.hear(step(number, mode))
            wall.now_ns += SECOND // 10
        assert clock.now_ns() == NOW_NS + numbers[-1] * SECOND
        assert clock.step == numbers[-1]
