"""Randomness by address: a draw depends on its seed and its names, and on nothing drawn before.

`generator` gives a numpy generator for what is drawn as a whole. `TargetDraws` gives each target
its own draws at each report, for all targets at once: a counter-based Philox whose counter is
(target number, report, purpose), so that no target's noise moves when another comes or goes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimation.arrays import Array

Words = NDArray[np.uint64]
Address = tuple[int, str]
"""A report by its number, and what the draw is for."""
_MASK = 0xFFFFFFFF
_MULTIPLIERS = (0xD2511F53, 0xCD9E8D57)
_WEYL = (0x9E3779B9, 0xBB67AE85)
_ROUNDS = 10


@cache
def stable_hash(name: str, bits: int = 64) -> int:
    """A hash of a name, the same in every process and on every machine; `bits` in eights."""
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=bits // 8).digest(), "little")


def generator(seed: int, *names: str | int) -> np.random.Generator:
    """The generator at an address, such as ("carrier", "levante", "errors")."""
    return np.random.default_rng(_sequence(seed, names))


class TargetDraws(NamedTuple):
    """The draws of one source for every target.

    Attributes:
        key: of the Philox, from the seed and the source's names.
    """

    key: tuple[int, int]

    @classmethod
    def of(cls, seed: int, *names: str) -> TargetDraws:
        """The draws at an address."""
        first, second = _sequence(seed, names).generate_state(2)
        return cls((int(first), int(second)))

    def at(self, numbers: ArrayLike, addresses: Sequence[Address]) -> Array:
        """Two numbers in (0, 1) for each target at each address.

        Args:
            numbers: (N,) of the targets, below 2^32.
            addresses: P of them.

        Returns:
            (P, N, 2); `normal` makes normal numbers of them.
        """
        words = philox(_counters(np.asarray(numbers, dtype=np.uint64), addresses), self.key)
        whole = (words[..., 0::2] << 21) ^ (words[..., 1::2] >> 11)  # 53 bits
        shares: Array = (whole.astype(float) + 0.5) * 2.0**-53
        return shares


def normal(uniform: Array) -> Array:
    """Two standard normal numbers (..., 2) of two uniform ones, after Box and Muller."""
    radius, turn = np.sqrt(-2 * np.log(uniform[..., 0])), 2 * np.pi * uniform[..., 1]
    return np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=-1)


def philox(counter: Words, key: tuple[int, int]) -> Words:
    """Philox4x32-10: random words (..., 4) of counters (..., 4), all below 2^32.

    numpy has Philox only as a stream; here every counter is its own draw.
    Source: Salmon et al., Parallel random numbers: as easy as 1, 2, 3 (SC 2011).
    """
    a, b, c, d = np.moveaxis(counter, -1, 0)
    k0, k1 = key
    for _ in range(_ROUNDS):
        left, right = a * _MULTIPLIERS[0], c * _MULTIPLIERS[1]
        a, b, c, d = (right >> 32) ^ b ^ k0, right & _MASK, (left >> 32) ^ d ^ k1, left & _MASK
        k0, k1 = (k0 + _WEYL[0]) & _MASK, (k1 + _WEYL[1]) & _MASK
    return np.stack([a, b, c, d], axis=-1)


def _counters(numbers: Words, addresses: Sequence[Address]) -> Words:
    counters = np.empty((len(addresses), len(numbers), 4), dtype=np.uint64)
    counters[..., 0] = numbers
    for row, (report, purpose) in zip(counters, addresses, strict=True):
        row[:, 1:] = report & _MASK, stable_hash(purpose, bits=32), report >> 32
    return counters


def _sequence(seed: int, names: tuple[str | int, ...]) -> np.random.SeedSequence:
    spawn_key = tuple(n if isinstance(n, int) else stable_hash(n) for n in names)
    return np.random.SeedSequence(seed, spawn_key=spawn_key)
