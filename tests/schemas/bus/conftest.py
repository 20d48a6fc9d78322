"""The networks that the laws of a bus are tested on."""

from collections.abc import Iterator

import pytest

from schemas.bus.memory_bus import MemoryNetwork
from tests.schemas.bus.bus_networks import ZenohNetwork

Network = MemoryNetwork | ZenohNetwork


@pytest.fixture(params=["memory", pytest.param("zenoh", marks=pytest.mark.live)])
def network(request: pytest.FixtureRequest) -> Iterator[Network]:
    """An empty network of either kind."""
    made: Network = (
        MemoryNetwork()
        if request.param == "memory"
        else ZenohNetwork(request.getfixturevalue("hub"))
    )
    yield made
    made.close()
