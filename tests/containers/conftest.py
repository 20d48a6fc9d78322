"""The image under test, built once, as from a clean checkout."""

from __future__ import annotations

import secrets
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.containers.engine import BUILD_S, base_image, compose_command, image, run
from tests.project.tree import ROOT, tracked_files


@pytest.fixture(scope="session")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tracked files alone, and the wheels of what they depend on."""
    compose_command()
    folder = tmp_path_factory.mktemp("checkout")
    for path in tracked_files():
        copy = folder / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, copy)
    run([str(folder / "docker" / "wheels.sh")], timeout_s=BUILD_S, PYTHON=sys.executable)
    return folder


@pytest.fixture(scope="session")
def built(checkout: Path) -> Iterator[str]:
    tag = f"crossfix-test-{secrets.token_hex(4)}"
    with base_image(checkout, f"{tag}-base") as base, image(checkout, base, tag):
        yield tag
