"""Recording and replay beside the bare `mcap` library and raw Zenoh, measured in the same run."""
