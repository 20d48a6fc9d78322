"""Messages as columns: one row a message, or one for each log, track, target it speaks of."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from schemas import messages as m
from schemas.errors import CrossfixError

if TYPE_CHECKING:
    import pandas as pd  # type: ignore[import-not-found, import-untyped, unused-ignore]
    import polars as pl  # type: ignore[import-not-found, unused-ignore]

Scalar = bool | int | float | str
Row = dict[str, Scalar]
"""A row by the names of its columns; what is absent has no value."""
AnyArray = NDArray[Any]
EXACT_IN_FLOAT = 2**53
LIST_OF = {
    m.Tracks: "tracks",
    m.Association: "targets",
    m.Quality: "sources",
    m.Alignment: "beacons",
}
"""Messages with one row for each entry of a list."""
COLUMNAR = (m.SourceReport, m.TruthTargets, m.TruthCarriers)
"""Messages whose lists are columns already: a row for each place in them."""
LONGEST = 78
"""Of a list of numbers whose elements get a column each: the largest covariance."""


class Columns(Mapping[str, AnyArray]):
    """Columns by name, all of one length.

    A number that is absent is nan, a text that is absent is empty, and a column of integers of
    which some are absent is one of floats.
    """

    def __init__(self, columns: Mapping[str, AnyArray], rows: int) -> None:
        self._columns, self.rows = dict(columns), rows

    def __getitem__(self, name: str) -> AnyArray:
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __repr__(self) -> str:
        return f"Columns({self.rows} rows: {', '.join(self)})"

    def to_pandas(self) -> pd.DataFrame:
        """The same as a data frame of pandas.

        Raises:
            CrossfixError: pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise _not_installed("pandas") from None
        return pd.DataFrame(self._columns)

    def to_polars(self) -> pl.DataFrame:
        """The same as a data frame of polars.

        Raises:
            CrossfixError: polars is not installed.
        """
        try:
            import polars as pl
        except ImportError:
            raise _not_installed("polars") from None
        return pl.DataFrame(self._columns)


def columns_of(rows: Iterable[Row]) -> Columns:
    """Rows turned into columns, in the order in which they appear."""
    values: dict[str, list[Scalar | None]] = {}
    count = 0
    for row in rows:
        for name, value in row.items():
            column = values.setdefault(name, [])
            column.extend([None] * (count - len(column)))
            column.append(value)
        count += 1
    for column in values.values():
        column.extend([None] * (count - len(column)))
    return Columns({name: _array(column) for name, column in values.items()}, count)


def rows_of(message: Struct) -> Iterator[Row]:
    """The rows of one message: its own fields, then those of what it speaks of.

    Names are dotted; the elements of a list of numbers end in their index.
    """
    if isinstance(message, COLUMNAR):
        yield from _columnar_rows(message)
        return
    name = LIST_OF.get(type(message))
    own = dict(_flat_fields(message, "", without=(name,) if name else ()))
    if name is None:
        yield own
        return
    for entry in getattr(message, name):
        yield own | dict(_flat_fields(entry, f"{name}."))


def _columnar_rows(message: m.SourceReport | m.TruthTargets | m.TruthCarriers) -> Iterator[Row]:
    lists: dict[str, Sequence[Any]] = {}
    own: Row = {}
    for name in message.__struct_fields__:
        value = getattr(message, name)
        if name == "features":
            lists |= dict(_features(value))
        elif isinstance(value, list):
            lists[name] = value
        else:
            own |= dict(_flat(name, value))
    filled = {name: column for name, column in lists.items() if column}
    for n in range(max(map(len, filled.values()), default=0)):
        row = dict(own)
        for name, column in filled.items():
            row |= dict(_flat(name, column[n]))
        yield row


def _features(features: Mapping[str, Any]) -> Iterator[tuple[str, Sequence[Any]]]:
    for name, feature in features.items():
        if isinstance(feature, m.FeatureColumn):
            yield f"features.{name}", feature.values
            if feature.sigmas is not None:
                yield f"features.{name}.sigma", feature.sigmas
        else:
            yield f"features.{name}", feature


def _flat_fields(
    struct: Struct, prefix: str, without: Sequence[str] = ()
) -> Iterator[tuple[str, Scalar]]:
    for name in struct.__struct_fields__:
        if name not in without:
            yield from _flat(prefix + name, getattr(struct, name))


def _flat(name: str, value: Any) -> Iterator[tuple[str, Scalar]]:
    if isinstance(value, Struct):
        yield from _flat_fields(value, f"{name}.")
    elif isinstance(value, bool | int | float | str):
        yield name, value
    elif isinstance(value, list) and value and len(value) <= LONGEST and _are_numbers(value):
        for n, number in enumerate(value):
            yield f"{name}.{n}", number
    elif isinstance(value, dict) and all(isinstance(v, Scalar) for v in value.values()):
        for key, inner in value.items():
            yield f"{name}.{key}", inner
    elif value is not None and value != []:
        yield name, json.dumps(msgspec.to_builtins(value))


def _are_numbers(values: Sequence[Any]) -> bool:
    return all(isinstance(value, int | float) for value in values)


def _array(column: Sequence[Scalar | None]) -> AnyArray:
    """A column in the narrowest type that holds it."""
    kinds = {type(value) for value in column if value is not None}
    is_full = None not in column
    if kinds == {bool} and is_full:
        return np.array(column, dtype=bool)
    if kinds == {int} and is_full:
        return np.array(column, dtype=np.int64)
    if kinds <= {int, float, bool} and not _would_lose(column):
        return np.array([np.nan if v is None else v for v in column], dtype=np.float64)
    if kinds == {str}:
        return np.array(["" if value is None else value for value in column], dtype=np.str_)
    return np.array(column, dtype=object)


def _would_lose(column: Sequence[Scalar | None]) -> bool:
    """Whether an integer is too large for a float."""
    return any(isinstance(value, int) and abs(value) > EXACT_IN_FLOAT for value in column)


def _not_installed(name: str) -> CrossfixError:
    return CrossfixError(f"{name} is not installed", expected=f"pip install {name}")
