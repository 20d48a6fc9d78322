"""Bad input: random and mutated payloads against ingest, recorder, checker and a running scenario.

    python -m bench.bad_input [--seed N] [--runs N] [--json]

`--runs` counts thousands of payloads; a fifth as many flood the running scenario.
"""

from __future__ import annotations

import logging
import tempfile
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.figures import Figure, at_least, at_most, options, report, scale, told
from fusion_center.admission.lives import Lives
from fusion_center.process.ingest import Ingest
from schemas.bus.memory_bus import MemoryNetwork
from schemas.bus.zenoh_bus import open_bus
from schemas.conformance import Conformance
from schemas.recording.reader import open_recording
from tests.bad_input.payloads import Chaos
from tests.bad_input.test_flood import RUN, publish, readable, started
from tests.bad_input.test_running import PATROL, forgeries, put
from tests.live.live_run import LiveRun
from tests.schemas.conformance.test_residuals import checked
from tests.whole.recorded import outputs
from tests.whole.refusing import refused

MB = 1024 * 1024


def main() -> None:
    """Measure everything and print it."""
    given = options(__doc__ or "", runs=100)
    logging.disable(logging.WARNING)
    with tempfile.TemporaryDirectory() as folder:
        report(_figures(Path(folder), given.seed, 1000 * given.runs), given)


def _figures(folder: Path, seed: int, count: int) -> Iterator[Figure]:
    yield from _ingest(seed, count)
    yield from _recorder(folder, seed, count)
    yield from _checker(seed, count)
    yield from _running(folder, seed, count // 5)
    yield from _sigmas(seed, max(10, count // 500))


def _ingest(seed: int, count: int) -> Iterator[Figure]:
    samples = list(Chaos(seed, RUN).samples(count))
    ingest, started_s = Ingest(Lives()), time.process_time()
    crashes = 0
    tracemalloc.start()
    for sample in samples:
        try:
            ingest.accept(sample)
        except Exception:
            crashes += 1
    held_bytes = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    passed_s = (time.process_time() - started_s) * scale()
    rows = ingest.statistics()
    counted = sum(row.received + row.duplicates + row.rejected for row in rows)
    yield at_most("ingest: crashes", crashes, 0)
    yield at_least("ingest: payloads counted", counted, count, f"of {count}")
    yield at_most("ingest: memory held for strangers", held_bytes / MB, 64, "MB")
    yield told("ingest: payloads a second, memory traced", count / passed_s)


def _recorder(folder: Path, seed: int, count: int) -> Iterator[Figure]:
    path = folder / "flood.mcap"
    with MemoryNetwork() as network:
        recorder = started(network, path)
        sent = publish(network, Chaos(seed + 1, RUN).samples(count))
        recorder.finish("flooded", {})
        counts = recorder.counters()
    parts = ("recorded", "rejected", "repeated", "passed_over", "dropped")
    counted = sum(counts[part] for part in parts)
    yield at_least("recorder: payloads counted", counted, sent, f"of {sent}")
    yield at_least("recorder: recorded messages that decode", readable(path), counts["recorded"])
    yield told("recorder: messages recorded of those", counts["recorded"])


def _checker(seed: int, count: int) -> Iterator[Figure]:
    conformance, crashes = Conformance(RUN), 0
    for sample in Chaos(seed + 2, RUN).samples(count):
        try:
            conformance.take(sample, 1_767_225_700.0)
        except Exception:
            crashes += 1
    yield at_most("checker: crashes", crashes, 0)
    yield told("checker: kinds of findings", len({f.code for f in conformance.findings()}))


def _running(folder: Path, seed: int, count: int) -> Iterator[Figure]:
    """Live over Zenoh, in lock-step: forged and random samples while the run goes on."""
    still, path = folder / "still.mcap", folder / "flooded.mcap"
    with LiveRun(PATROL, still) as run:
        run.await_end()
    with LiveRun(PATROL, path) as run:
        run.await_step(2)
        with open_bus(run.endpoint) as bus:
            sent = put(bus, forgeries(run.run)) + put(bus, Chaos(seed, run.run).samples(count))
        code = run.await_end()
    yield at_most("live flood: exit code of the run", code, 0)
    yield at_least("live flood: outputs equal those without", outputs(path) == outputs(still), 1)
    yield at_least("live flood: re-fuses to the same bytes", outputs(path) == refused(path), 1)
    yield told("live flood: samples put", sent)
    with open_recording(path) as recording:
        yield told(
            "live flood: refused by the recorder", recording.end.rejected if recording.end else 0
        )


def _sigmas(seed: int, runs: int) -> Iterator[Figure]:
    dice = np.random.default_rng(seed)
    right = [check for _ in range(runs) for check in checked(dice, 24)]
    wrong = [check for _ in range(runs) for check in checked(dice, 60, 3.0)]
    alarms = sum(check.verdict != "consistent" for check in right)
    found = sum(check.verdict == "too small" for check in wrong)
    yield at_most("sigma check: false alarms", alarms, 0, f"of {len(right)}")
    yield at_least("sigma check: claims of a third found", found, len(wrong), f"of {len(wrong)}")


if __name__ == "__main__":
    main()
