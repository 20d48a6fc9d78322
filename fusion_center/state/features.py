"""What is remembered of the features of targets: which there are, how well sources report them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray


class Word(NamedTuple):
    """A feature with categories, those of all sources that report it."""

    name: str
    categories: tuple[str, ...]


class Dictionary(NamedTuple):
    """The features that sources of a run report: numbers by name, and words."""

    numbers: tuple[str, ...] = ()
    words: tuple[Word, ...] = ()


class Scale(Struct, frozen=True, kw_only=True):
    """What confident pairs have taught of a number of a source.

    Attributes:
        weight: pairs it rests on, those the declared sigma is worth included.
        squares: of their errors, each over the variance that was stated.
        stated: sigma of the newest values.
    """

    weight: float
    squares: float
    stated: float


class Reports(Struct, frozen=True, kw_only=True, eq=False):
    """What confident pairs have taught of a word of a source.

    Attributes:
        truth, words: names of the rows and of the columns.
        count: (K, M) reports of each word when each category was true, those imagined included.
    """

    truth: tuple[str, ...]
    words: tuple[str, ...]
    count: NDArray[np.float64]


class Learned(Struct, frozen=True, kw_only=True, eq=False):
    """What has been learnt of one source's features, by name."""

    numbers: dict[str, Scale] = {}
    words: dict[str, Reports] = {}
