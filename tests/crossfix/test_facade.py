"""The public names: all there, each the very object of its home, none imported before its use."""

import subprocess
import sys

import pytest

import crossfix
from crossfix.analysis import open_recording
from fusion_center.fuse import fuse


def test_every_public_name_is_there() -> None:
    assert crossfix.fuse is fuse
    assert crossfix.open_recording is open_recording
    for name in crossfix.__all__:
        assert getattr(crossfix, name) is not None
        assert name in dir(crossfix)


def test_an_unknown_name_is_an_ordinary_error() -> None:
    with pytest.raises(AttributeError, match="fusee"):
        crossfix.fusee  # noqa: B018


def test_importing_it_imports_nothing_else() -> None:
    program = "import sys, crossfix; print(*sys.modules)"
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    ours = {"schemas", "estimation", "sim_world", "carriers", "fusion_center", "numpy", "zenoh"}
    assert ours.isdisjoint(done.stdout.split())
