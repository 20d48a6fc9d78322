"""Measurements of what the pages claim; each runs as `python -m bench.NAME` (DESIGN 12)."""
