"""`docker compose up` on a real engine: runs to its end, survives a kill and a cut, records it.

The image is built as from a clean checkout, and everything that was made is removed in the end.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from crossfix.verification import Comparison, compare
from schemas import keys
from schemas.bus.zenoh_bus import open_bus
from schemas.messages import Closed, Health, Step
from schemas.recording.fingerprint import numeric_fingerprint
from schemas.recording.reader import open_recording
from tests.containers.composed import RECORDINGS, SERVICES, Composed, Onlooker
from tests.whole.recorded import messages, outputs

pytestmark = [pytest.mark.live, pytest.mark.slow, pytest.mark.timeout(1800)]
SHM_BYTES = 64 * 1024 * 1024
HUB_S = 30.0
KILLED = 137


def takes_part(carrier: str, closed: Closed) -> bool:
    return carrier in {end.carrier for end in closed.manifest}


def reason(path: Path) -> str:
    with open_recording(path) as recording:
        assert recording.end is not None
        assert (recording.end.gaps, recording.end.dropped) == (0, 0)
        return recording.end.reason


def fused_again(path: Path) -> Comparison:
    """Here, outside the containers: what the recording names is all that it takes."""
    with open_recording(path) as recording:
        here = numeric_fingerprint()
        if recording.header.fingerprint != here:
            pytest.skip(f"other bits: {here} here, {recording.header.fingerprint} in a container")
        return compare(recording)


def test_up_runs_the_default_scenario_to_its_end(
    checkout: Path, built: str, tmp_path: Path
) -> None:
    with Composed(checkout, built, duration_s=60) as project:
        project.compose("up", "--no-color")
        assert project.exit_codes() == dict.fromkeys(SERVICES, 0)
        for service in SERVICES:
            container = project.inspected(service)
            assert container["Config"]["User"] not in ("", "0", "root"), service
            assert container["HostConfig"]["ShmSize"] == SHM_BYTES
            assert container["HostConfig"]["ReadonlyRootfs"]
        path = project.fetch_recording(tmp_path)
        assert reason(path) == "finished"
        assert [c.step for c in messages(path, keys.CLOSED_FUSION, Closed)] == list(range(1, 61))
        corrections = [key for key, _ in outputs(path) if "/correction/" in key]
        assert corrections

        project.compose("up", "--no-color")  # once more: the first recording is left alone
        again = f"{RECORDINGS}/strait-2.mcap"
        said = project.compose("run", "--rm", "--no-deps", "fusion", "verify", again, "--refuse")
        assert "all equal to the byte" in said


def test_a_killed_and_a_cut_off_container_are_lost_at_once_and_the_run_goes_on(
    checkout: Path, built: str, tmp_path: Path
) -> None:
    with Composed(checkout, built, duration_s=3600) as project:  # it is stopped when all was seen
        project.compose("up", "--detach")
        with open_bus(project.endpoint, HUB_S) as bus:
            seen = Onlooker(bus, keys.STEP, keys.HEALTH, keys.CLOSED_FUSION)
            seen.await_message(Step, lambda step: step.step >= 20)
            assert all(project.is_healthy(service) for service in SERVICES)
            assert project.is_healthy("fusion", asked_in="world")

            project.compose("kill", "poniente")
            assert seen.await_message(Health, lambda h: "poniente" in h.lost).lost == ["poniente"]
            assert not project.is_healthy("poniente")

            with project.cut_off("siroco"):
                seen.await_message(Health, lambda h: "siroco" in h.lost)
                seen.await_message(Closed, lambda c: not takes_part("siroco", c))
            seen.await_message(Closed, lambda c: takes_part("siroco", c))
        project.compose("stop", "world")
        assert project.exit_codes() == dict.fromkeys(SERVICES, 0) | {"poniente": KILLED}
        path = project.fetch_recording(tmp_path)

    assert reason(path) == "interrupted"
    steps = list(messages(path, keys.CLOSED_FUSION, Closed))
    assert [step.step for step in steps] == list(range(1, len(steps) + 1))
    # A hub that waited for the lost link would cost levante its place.
    assert [step.lost for step in steps if step.lost] == [["poniente"], ["siroco"]]
    boots = {e.boot for step in steps for e in step.manifest if e.carrier == "siroco"}
    assert len(boots) == 2
    again = fused_again(path)
    assert again.difference is None
    assert again.equal == len(outputs(path))
