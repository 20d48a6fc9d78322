"""Who hears whom: pseudoranges among carriers, a controller and ground points, as linear rows.

The states are corrections to dead reckoning: of a user (x, y, vx, vy, z, b, f) with the clock
offset b [m] and its drift f [m/s]; of a controller that only knows its place to so much (x, y, z).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array

USER_STATES = 7
X, Y, VX, VY, Z, CLOCK, DRIFT = range(USER_STATES)


class Network(NamedTuple):
    """Nodes and their states.

    Attributes:
        state_of: (K, 4) index of each node's x, y, z and clock in the joint state; -1: known.
        size: N of the joint state.
    """

    state_of: NDArray[np.intp]
    size: int

    def states(self, user: int) -> NDArray[np.intp]:
        """Indices (7,) of one user's states; users are the first nodes."""
        return USER_STATES * user + np.arange(USER_STATES)


class Pseudoranges(NamedTuple):
    """Ranges by the clocks: |place of receiver - of transmitter| + b of the one - b of the other.

    Attributes:
        receiver: (m,) nodes.
        transmitter: (m,) nodes.
        value_m: (m,).
        sigma_m: (m,).
    """

    receiver: NDArray[np.intp]
    transmitter: NDArray[np.intp]
    value_m: Array
    sigma_m: Array


class Seen(NamedTuple):
    """Pseudoranges as rows of a filter.

    Attributes:
        innovation: (m,) measured less predicted.
        by_state: (m, N).
        noise: (m, m).
        unit: (m, 3) from transmitter to receiver.
    """

    innovation: Array
    by_state: Array
    noise: Array
    unit: Array


def network(users: int, uncertain: int = 0, known: int = 0) -> Network:
    """Nodes in the order users, uncertain places with a perfect clock, known ground points."""
    own = USER_STATES * np.arange(users)[:, None] + np.array([X, Y, Z, CLOCK])
    places = USER_STATES * users + 3 * np.arange(uncertain)[:, None] + np.arange(3)
    uncertain_nodes = np.column_stack([places, np.full(uncertain, -1)])
    nodes = np.vstack([own, uncertain_nodes, np.full((known, 4), -1)])
    return Network(nodes, USER_STATES * users + 3 * uncertain)


def links(pairs: list[tuple[int, int]], sigma_m: float) -> Pseudoranges:
    """Who hears whom (receiver, transmitter), no values yet."""
    nodes = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    blank = np.zeros(len(nodes))
    return Pseudoranges(nodes[:, 0], nodes[:, 1], blank, np.full(len(nodes), sigma_m))


def seen(net: Network, reckoned_m: Array, mean: Array, heard: Pseudoranges) -> Seen:
    """Rows of pseudoranges about an estimate.

    Args:
        net: who has which states.
        reckoned_m: (K, 3) places of the nodes by dead reckoning; of known ones as they are.
        mean: (N,) estimated corrections.
        heard: m pseudoranges.
    """
    padded = np.append(mean, 0.0)  # index -1: known, no correction
    places = reckoned_m + padded[net.state_of[:, :3]]
    clock = padded[net.state_of[:, 3]]
    apart = places[heard.receiver] - places[heard.transmitter]
    distance = np.linalg.norm(apart, axis=1)
    unit = apart / np.maximum(distance, 1e-9)[:, None]
    predicted_m = distance + clock[heard.receiver] - clock[heard.transmitter]
    rows = np.arange(len(distance))[:, None]
    wide = np.zeros((len(distance), net.size + 1))
    columns = np.column_stack([unit, np.ones(len(unit))])
    wide[rows, net.state_of[heard.receiver]] += columns
    wide[rows, net.state_of[heard.transmitter]] -= columns
    noise = np.diag(heard.sigma_m**2)
    return Seen(heard.value_m - predicted_m, wide[:, :-1], noise, unit)
