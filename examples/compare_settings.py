"""Fuse a recording with several values of one setting and hold each result against the truth.

A recording holds the inputs of a run and, if it was simulated, its truth: so one run is enough to
ask what another setting would have given.

    python examples/compare_settings.py recordings/strait.mcap association.gate 4 9.21 16
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import crossfix
from crossfix.evaluation.recordings import frame_summaries
from sim_world.scenario import parse_override


def main() -> None:
    """Print a line for each value and carrier."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recording", type=Path)
    parser.add_argument("setting", help="dotted name, as in [fusion] of a scenario")
    parser.add_argument("values", nargs="+")
    asked = parser.parse_args()

    print(f"{asked.setting:>20}  carrier    error of its place before, after [m], sigma [m]")
    with TemporaryDirectory() as folder:
        for n, value in enumerate(asked.values):
            new = Path(folder) / f"{n}.mcap"
            with crossfix.open_recording(asked.recording) as recording:
                crossfix.refuse(recording, new, dict([parse_override(f"{asked.setting}={value}")]))
            for s in frame_summaries(new):
                errors = f"{s.before_m:9.1f} {s.after_m:9.1f} {s.sigma_m:9.1f}"
                print(f"{value:>20}  {s.carrier:9} {errors}")


if __name__ == "__main__":
    main()
