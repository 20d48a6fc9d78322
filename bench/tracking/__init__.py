"""The tracker of one picture, its demands and its peer: `python -m bench.tracking`."""
