"""What all tests share: one BLAS thread, hypothesis without chance, a hub."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before anything imports numpy

from collections.abc import Iterator

import pytest
from hypothesis import settings

from tests.hub_process import HubProcess

settings.register_profile("crossfix", derandomize=True, deadline=None)
settings.load_profile("crossfix")


@pytest.fixture(scope="session")
def hub() -> Iterator[str]:
    """Endpoint of a hub that runs for the whole session; isolate by the run id or by key."""
    with HubProcess() as process:
        yield process.endpoint
