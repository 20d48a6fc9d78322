#!/opt/crossfix/bin/python3
"""Whether a process of a run is well: its container's health check.

healthy RUN PROCESS: its liveliness token stands on the hub; a process that hangs loses it.
healthy RUN hub: the hub takes a newcomer and answers him.
"""

import os
import sys

from schemas import keys
from schemas.bus.zenoh_bus import open_bus
from schemas.errors import BusError

PATIENCE_S = 3.0


def is_well(endpoint: str, run: str, process: str) -> bool:
    """Ask the hub for the tokens of the run."""
    try:
        with open_bus(endpoint, PATIENCE_S) as bus:
            tokens = bus.tokens(keys.every_alive(run), PATIENCE_S)
    except BusError:
        return False
    return process == "hub" or process in {keys.parse_alive(token)[1] for token in tokens}


if __name__ == "__main__":
    sys.exit(not is_well(os.environ["CROSSFIX_HUB"], *sys.argv[1:]))
