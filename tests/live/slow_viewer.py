"""A viewer that takes 0.1 s for a sample of everything there is, as a process of its own."""

from __future__ import annotations

import sys
import time

import zenoh


def main(endpoint: str, run: str) -> None:
    """Watch until killed."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("transport/shared_memory/enabled", "false")
    with zenoh.open(config) as session:
        for _ in session.declare_subscriber(f"crossfix/@v1/{run}/**"):
            time.sleep(0.1)


if __name__ == "__main__":
    main(*sys.argv[1:])
