"""The end of a launch: who still fuses is waited for, who does nothing is asked to leave."""

from __future__ import annotations

import signal
from collections.abc import Callable

import pytest

from crossfix import launch as launching
from crossfix.launch import Child, Launch


def sleeper(name: str, seconds: float) -> Child:
    """A vital process that leaves by itself after so long."""
    statement = f"import time; time.sleep({seconds})"
    return Child(name, ["timeit", "-n", "1", "-r", "1", statement], vital=True)


@pytest.mark.parametrize(
    ("turn", "code"),
    [(Launch.has_fused, 0), (lambda launch: None, 128 + signal.SIGTERM)],
    ids=["goes on", "hangs"],
)
def test_after_the_world_a_centre_may_take_its_time_while_it_goes_on(
    turn: Callable[[Launch], None], code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(launching, "LEAVE_S", 0.3)
    with Launch(lambda name, line: None) as launch:
        launch.start([sleeper("world", 0.0), sleeper("fusion", 1.5)])
        assert launch.watch(lambda: turn(launch)) == code


def test_a_centre_that_goes_on_holds_up_no_run_that_has_failed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(launching, "FAIL_S", 0.3)
    world = Child("world", ["timeit", "no python"], vital=True)
    with Launch(lambda name, line: None) as launch:
        launch.start([world, sleeper("fusion", 60.0)])
        assert launch.watch(launch.has_fused) == 1
        assert launch.failed == "world"
