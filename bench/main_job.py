"""The main job live: same bytes, kills told, launches, start of ten carriers, steps a second.

    python -m bench.main_job [--seed N] [--runs N] [--json]

`--runs` counts the determinism runs; five times as many launches in a row are made.
"""

from __future__ import annotations

import os
import resource
import signal
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from bench.figures import Figure, at_least, at_most, options, report, scale, told
from crossfix.commands.run import RunOptions
from schemas import keys
from schemas.messages import Closed, Health, Step
from tests.live.live_run import LiveRun
from tests.live.test_main_job import PATROL, STRAIT, children_of, load, slow_viewer
from tests.whole.recorded import messages, outputs
from tests.whole.refusing import refused

CARRIERS = 10
AT_STEP = 500


def main() -> None:
    """Measure everything and print it."""
    given = options(__doc__ or "", runs=10)
    with tempfile.TemporaryDirectory() as folder:
        report(_figures(Path(folder), given.seed, given.runs), given)


def _figures(folder: Path, seed: int, runs: int) -> Iterator[Figure]:
    yield from _same_bytes(folder, seed, runs)
    yield from _default_scenario(folder, seed)
    yield from _kill_of_a_carrier(folder, seed)
    yield from _kill_of_the_centre(folder, seed)
    yield from _hung(folder, seed)
    yield from _hub(folder, seed)
    yield from _slow_centre(folder, seed)
    yield from _launches(folder, 5 * runs)
    yield from _ten_carriers(folder)


def _run(scenario: Path, output: Path, seed: int, **how: object) -> LiveRun:
    return LiveRun(scenario, output, RunOptions(seed=seed, **how))  # type: ignore[arg-type]


def _same_bytes(folder: Path, seed: int, runs: int) -> Iterator[Figure]:
    """Live lock-step runs of one seed, every third delayed, every third loaded and watched."""
    recorded, repeated = [], 0
    for number in range(runs):
        path = folder / f"same-{number}.mcap"
        if number % 3 == 1:
            with _run(PATROL, path, seed, delay=0.03) as run:
                run.await_end()
        elif number % 3 == 2:
            with load(), _run(PATROL, path, seed) as run, slow_viewer(run):
                run.await_end()
        else:
            with _run(PATROL, path, seed) as run:
                run.await_end()
        recorded.append(outputs(path))
        repeated += outputs(path) == refused(path)
    same = sum(each == recorded[0] for each in recorded)
    yield at_least("live lock-step runs with equal outputs", same, runs, f"of {runs}")
    yield at_least("recordings that re-fuse to the same bytes", repeated, runs, f"of {runs}")


def _default_scenario(folder: Path, seed: int) -> Iterator[Figure]:
    path = folder / "strait.mcap"
    started_s = time.monotonic()
    with _run(STRAIT, path, seed) as run:
        code = run.await_end()
    passed_s = (time.monotonic() - started_s) * scale()
    yield at_most("strait: 10 simulated minutes at --rate max", passed_s, 30, "s, scaled")
    yield at_most("strait: exit code", code, 0)
    yield told("strait: messages a second fused", len(outputs(path)) / passed_s)


def _kill_of_a_carrier(folder: Path, seed: int) -> Iterator[Figure]:
    path = folder / "killed.mcap"
    with _run(PATROL, path, seed, delay=0.1) as run:
        run.await_step(10)
        killed_s = time.monotonic()
        run.signal("bravo", signal.SIGKILL)
        run.await_news("bravo is lost")
        told_s = time.monotonic() - killed_s
        run.await_end()
    yield at_most("carrier killed: told in health after", told_s, 0.5, "s")
    yield at_least("carrier killed: steps closed", len(_closed(path)), 60)
    yield at_least("carrier killed: re-fuses to the same bytes", outputs(path) == refused(path), 1)


def _kill_of_the_centre(folder: Path, seed: int) -> Iterator[Figure]:
    """The recording up to 0.3 s before the kill is readable: at least half of the steps here."""
    path = folder / "centre.mcap"
    with _run(PATROL, path, seed, delay=0.1) as run:
        run.await_step(30)
        run.signal("fusion", signal.SIGKILL)
        code = run.await_end()
    last = max(c.step for c in _closed(path))
    yield at_most("fusion centre killed: exit code of the run", code, 128 + signal.SIGKILL)
    yield at_least("fusion centre killed at step 30: steps readable", last, 15)


def _hung(folder: Path, seed: int) -> Iterator[Figure]:
    path = folder / "hung.mcap"
    with _run(PATROL, path, seed, delay=0.1) as run:
        run.await_step(10)
        stopped_s = time.monotonic()
        run.signal("bravo", signal.SIGSTOP)
        run.await_news("bravo is lost")
        told_s = time.monotonic() - stopped_s
        run.signal("bravo", signal.SIGCONT)
        run.await_end()
    yield at_most("carrier hung: given up after", told_s, 2.5, "s")
    boots = {e.boot for c in _closed(path) for e in c.manifest if e.carrier == "bravo"}
    yield at_least("carrier hung and resumed: boots that took part", len(boots), 2)


def _hub(folder: Path, seed: int) -> Iterator[Figure]:
    path = folder / "hub.mcap"
    with _run(PATROL, path, seed, delay=0.1) as run:
        run.await_step(10)
        run.signal("hub", signal.SIGKILL)
        run.await_end()
    missing = sum(len(c.gave_up) + len(c.lost) for c in _closed(path))
    yield at_most("hub killed and restarted: messages or carriers missing", missing, 0)
    yield at_least("hub killed and restarted: steps closed", len(_closed(path)), 60)


def _slow_centre(folder: Path, seed: int) -> Iterator[Figure]:
    """A fusion centre at a third of the speed of a paced world; everything is fused in the end."""
    path = folder / "slow.mcap"
    run = _run(STRAIT, path, seed, rate="60")
    run.slow_down("fusion", 0.05)
    with run:
        run.await_message(Step, lambda step: bool(step.ended))
        run.await_message(Health, lambda health: health.step > AT_STEP)
        peaks = run.peak_mb()
        run.await_end()
    yield at_least("slow fusion centre: steps closed", len(_closed(path)), 600)
    yield at_most("slow fusion centre: largest process", max(peaks.values()), 250, "MB")
    for name, peak in sorted(peaks.items()):
        yield told(f"slow fusion centre: {name}", peak, "MB")


def _launches(folder: Path, launches: int) -> Iterator[Figure]:
    good = 0
    for number in range(launches):
        with LiveRun(PATROL, folder / f"launch-{number}.mcap") as run:
            run.await_step(1)
            run.launch.interrupt()
            good += run.await_end() == 0
    yield at_least("launches in a row that ended well", good, launches)
    yield at_most("processes left behind", len(children_of(os.getpid())), 0)
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    yield told("largest process so far", children.ru_maxrss / 1024, "MB")


def _ten_carriers(folder: Path) -> Iterator[Figure]:
    """From launch to the first step, the best of three: the others measure the neighbours."""
    head, first, *_ = PATROL.read_text().split("[[carriers]]")
    targets = "[[target_groups]]" + PATROL.read_text().split("[[target_groups]]")[1]
    carriers = [
        "[[carriers]]" + first.replace("alpha", f"c{n}").replace("north_m=0", f"north_m={500 * n}")
        for n in range(CARRIERS)
    ]
    scenario = folder / "ten.toml"
    scenario.write_text(head.replace("patrol", "ten") + "".join(carriers) + targets)
    times = []
    for number in range(3):
        run = LiveRun(scenario, folder / f"ten-{number}.mcap")
        started_s = time.monotonic()
        with run:
            run.await_step(1)
            times.append(time.monotonic() - started_s)
            run.launch.interrupt()
            run.await_end()
    yield at_most("ten carriers: launch to first step", min(times) * scale(), 1.5, "s, scaled")
    yield told("ten carriers: as measured, least of three", min(times), "s")


def _closed(path: Path) -> list[Closed]:
    return list(messages(path, keys.CLOSED_FUSION, Closed))


if __name__ == "__main__":
    main()
