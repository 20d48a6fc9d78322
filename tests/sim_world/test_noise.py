"""Laws of addressed randomness: known answers, independence of company, the right distributions."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_world.noise import TargetDraws, generator, normal, philox, stable_hash

FULL = 0xFFFFFFFF
KNOWN_ANSWERS = [
    # counter, key, words: kat_vectors of Random123, philox4x32 with 10 rounds
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((FULL,) * 4, (FULL,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]
ADDRESSES = [(4, "polar"), (0, "identity")]
NUMBERS = st.lists(st.integers(0, FULL), min_size=1, max_size=20, unique=True)


@pytest.mark.parametrize(("counter", "key", "words"), KNOWN_ANSWERS)
def test_philox_gives_the_published_answers(
    counter: tuple[int, ...], key: tuple[int, int], words: tuple[int, ...]
) -> None:
    assert tuple(philox(np.array(counter, dtype=np.uint64), key)) == words


@given(NUMBERS, st.integers(0, 2**63), st.data())
def test_a_target_draws_the_same_in_any_company(
    numbers: list[int], seed: int, data: st.DataObject
) -> None:
    draws = TargetDraws.of(seed, "sensor", "own", "radar")
    together = draws.at(numbers, ADDRESSES)
    some = data.draw(st.lists(st.sampled_from(range(len(numbers))), min_size=1))
    assert np.array_equal(draws.at([numbers[n] for n in some], ADDRESSES), together[:, some])
    assert np.array_equal(draws.at(numbers, ADDRESSES[1:]), together[1:])


def test_every_part_of_an_address_matters() -> None:
    def draw(seed: int = 1, name: str = "radar", number: int = 5, at: tuple[int, str] = (2, "x")):
        return TargetDraws.of(seed, "sensor", "own", name).at([number], [at]).tobytes()

    others = [
        draw(seed=2), draw(name="lidar"), draw(number=6), draw(at=(3, "x")), draw(at=(2, "y")),
        draw(at=(2 + 2**32, "x")),
    ]  # fmt: skip
    assert len({draw(), *others}) == len(others) + 1


def test_draws_are_uniform_and_normal_and_uncorrelated() -> None:
    n = 200_000
    uniform = TargetDraws.of(3, "a").at(np.arange(n), [(0, "x"), (1, "x")])
    flat = uniform.transpose(0, 2, 1).reshape(4, n)
    counts = np.array([np.histogram(u, bins=50, range=(0, 1))[0] for u in flat])
    chi2 = ((counts - n / 50) ** 2 / (n / 50)).sum(axis=1)
    assert np.all(np.abs(chi2 - 49) < 5 * np.sqrt(2 * 49))  # 5 sigma of chi2 with 49 dof
    z = normal(uniform).transpose(0, 2, 1).reshape(4, n)
    assert np.all(np.abs(z.mean(axis=1)) < 5 / np.sqrt(n))
    assert np.all(np.abs(z.var(axis=1) - 1) < 5 * np.sqrt(2 / n))
    assert np.all(np.abs((z**4).mean(axis=1) - 3) < 5 * np.sqrt(96 / n))
    assert np.all(np.abs(np.corrcoef(z) - np.eye(4)) < 5 / np.sqrt(n))
    neighbours = np.corrcoef(z[0, 1:], z[0, :-1])[0, 1]
    assert abs(neighbours) < 5 / np.sqrt(n)


def test_generators_differ_by_address_and_repeat_by_it() -> None:
    first = generator(1, "carrier", "own", "errors").standard_normal(3)
    assert np.array_equal(first, generator(1, "carrier", "own", "errors").standard_normal(3))
    for seed, names in [(2, ("carrier", "own")), (1, ("carrier", "other")), (1, ("carrier", 1))]:
        assert not np.array_equal(first, generator(seed, *names, "errors").standard_normal(3))


def test_hashes_are_the_same_in_another_process() -> None:
    program = "from sim_world.noise import stable_hash; print(stable_hash('levante', bits=32))"
    command = [sys.executable, "-c", program]
    printed = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
    assert int(printed) == stable_hash("levante", bits=32) == 2831819414  # b2sum -l 32
