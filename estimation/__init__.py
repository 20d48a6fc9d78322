"""The papers as pure functions on arrays: no I/O, no clock, no global state.

Import the module you need (`estimation.frames`, `estimation.relative_frame`, ...): nothing is
imported here, so that a process which only turns coordinates never pays for scipy. What there is,
with a short program for each paper: docs/library.md.
"""
