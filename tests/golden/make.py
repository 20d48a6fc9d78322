"""Makes the golden recordings: `python -m tests.golden.make [NAME ...] [--anew]`.

Without `--anew` the inputs stay as they are, only the outputs are fused again, and what has changed
in them is told: that belongs into the message of the commit. With it the scenario is run once more.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from crossfix.__main__ import main as crossfix
from crossfix.analysis import open_recording
from crossfix.refusing import refuse
from schemas.bus.memory_bus import MemoryNetwork
from sim_world.scenario import load_scenario
from tests.whole.in_memory import MemoryRun

FOLDER = Path(__file__).parent
SCENARIOS = FOLDER.parents[1] / "scenarios"
DURATION_S = 60


class Golden(NamedTuple):
    """One golden recording: a scenario, its seed, and what else is set."""

    name: str
    scenario: str
    seed: int

    @property
    def path(self) -> Path:
        """Where it is."""
        return FOLDER / f"{self.name}.mcap"


GOLDENS = (Golden("strait", "strait.toml", 7), Golden("paper000", "paper000.toml", 7))


def fused_again(golden: Golden, target: Path) -> None:
    """The same inputs with the outputs of today."""
    with open_recording(golden.path) as recording:
        refuse(recording, target, {})


def run_anew(golden: Golden, target: Path) -> None:
    """The scenario run once more, in one process."""
    overrides = {"time.duration_s": DURATION_S, "seed": golden.seed}
    scenario = load_scenario(SCENARIOS / golden.scenario, overrides)
    MemoryRun(scenario, MemoryNetwork(), target).carry_out()


def make(golden: Golden, *, anew: bool) -> None:
    """Make a recording and tell what has changed."""
    with TemporaryDirectory(dir=FOLDER) as folder:
        made = Path(folder) / golden.path.name
        (run_anew if anew or not golden.path.exists() else fused_again)(golden, made)
        if golden.path.exists():
            told_difference(golden.path, made)
        made.replace(golden.path)
    print(f"{golden.path.name}: {golden.path.stat().st_size} bytes")  # noqa: T201


def told_difference(before: Path, after: Path) -> None:
    """Print what `crossfix diff` says of the outputs."""
    try:
        crossfix(["diff", str(before), str(after), "--role", "output"])
    except SystemExit:
        return


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="only these; by default all")
    parser.add_argument("--anew", action="store_true", help="run the scenario once more")
    asked = parser.parse_args()
    for one in GOLDENS:
        if not asked.names or one.name in asked.names:
            make(one, anew=asked.anew)
