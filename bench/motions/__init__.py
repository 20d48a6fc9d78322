"""Tracks of hard and of real motions, by kind of motion: `python -m bench.motions`."""
