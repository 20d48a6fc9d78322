"""`messages_of(Message)`: a hypothesis strategy for any valid message, from its type alone."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import strategies as st
from msgspec import inspect as types

from schemas import messages as m

_INT64 = 2**63 - 1


@pytest.fixture(scope="session")
def messages_of() -> Callable[[type[msgspec.Struct]], st.SearchStrategy[Any]]:
    return _messages


@cache
def _messages(message: type[msgspec.Struct]) -> st.SearchStrategy[Any]:
    """Any valid value of a struct, fields with defaults sometimes left out."""
    if message is m.SourceReport:
        return st.integers(0, 3).flatmap(_reports)
    if message is m.TrackFilter:
        return st.integers(2, 4).flatmap(_filters)
    if message is m.Pose:
        return _builds(message, covariance=st.none() | _triangles(3, 6))
    if message is m.Feedback:
        return _builds(message, covariance=_triangles(3))
    return _builds(message)


def _triangles(*orders: int) -> st.SearchStrategy[list[float]]:
    """Upper triangles of positive definite matrices of one of the orders."""
    return st.tuples(st.sampled_from(orders), st.integers(0, 2**32 - 1)).map(_triangle)


def _triangle(order_and_seed: tuple[int, int]) -> list[float]:
    order, seed = order_and_seed
    root = np.random.default_rng(seed).normal(size=(order, order))
    matrix = root @ root.T + np.eye(order)
    return [float(x) for x in matrix[np.triu_indices(order)]]


def _builds(
    message: type[msgspec.Struct], **given: st.SearchStrategy[Any]
) -> st.SearchStrategy[Any]:
    required: dict[str, st.SearchStrategy[Any]] = {}
    optional: dict[str, st.SearchStrategy[Any]] = {}
    for field in types.type_info(message).fields:  # type: ignore[attr-defined]
        values = given[field.name] if field.name in given else _values(field.type)
        (required if field.required else optional)[field.name] = values
    return st.fixed_dictionaries(required, optional=optional).map(lambda kw: message(**kw))


def _filters(order: int) -> st.SearchStrategy[Any]:
    states = st.lists(st.floats(-1e6, 1e6), min_size=order, max_size=order)
    return _builds(m.TrackFilter, state=states, covariance=_triangles(order))


def _reports(logs: int) -> st.SearchStrategy[Any]:
    """Reports whose columns all have one length."""
    fields = types.type_info(m.SourceReport).fields  # type: ignore[attr-defined]
    columns = {f.name: _column(f.type.types[0], logs) for f in fields if f.name in m.COLUMNS}
    features = st.dictionaries(_ID, _features(logs), max_size=2)
    return _builds(m.SourceReport, features=features, **columns)


def _column(column: types.ListType, logs: int) -> st.SearchStrategy[Any]:
    item = column.item_type
    triangle = next((t for t in getattr(item, "types", ()) if _is_triangle(t)), None)
    cells = st.none() | _triangles(2, 3) if triangle else _values(item)
    return st.lists(cells, min_size=logs, max_size=logs)


def _features(logs: int) -> st.SearchStrategy[Any]:
    values, sigmas = st.none() | st.floats(-1e18, 1e18) | _TEXT, st.none() | st.floats(1e-9, 1e12)
    return st.builds(
        m.FeatureColumn,
        values=st.lists(values, min_size=logs, max_size=logs),
        sigmas=st.none() | st.lists(sigmas, min_size=logs, max_size=logs),
    )


def _is_triangle(kind: types.Type) -> bool:
    return isinstance(kind, types.ListType) and kind.max_length == 78


def _values(kind: types.Type) -> st.SearchStrategy[Any]:  # noqa: PLR0911 - one line a kind
    match kind:
        case types.UnionType(types=members):
            return st.one_of(*map(_values, members))
        case types.ListType(item_type=item, min_length=least, max_length=most):
            if _is_triangle(kind):
                return _triangles(2, 3, 4)
            return st.lists(_values(item), min_size=least or 0, max_size=min(most or 3, 3))
        case types.DictType(key_type=key, value_type=value):
            return st.dictionaries(_values(key), _values(value), max_size=2)
        case types.StructType(cls=cls):
            return _messages(cls)
        case types.LiteralType(values=values):
            return st.sampled_from(values)
        case types.IntType(ge=least, le=most):
            return st.integers(-_INT64 if least is None else least, most or _INT64)
        case types.FloatType(ge=least, gt=above, le=most):
            return st.floats(above if least is None else least, most, exclude_min=above is not None)
        case types.StrType(pattern=pattern):
            return _ID if pattern else _TEXT
    return _SIMPLE[type(kind)]


_ID = st.text("abcxyz0189_-", min_size=1, max_size=32)
_TEXT = st.text(max_size=8)
_SIMPLE: dict[type[types.Type], st.SearchStrategy[Any]] = {
    types.BoolType: st.booleans(),
    types.BytesType: st.binary(max_size=20),
    types.NoneType: st.none(),
    types.AnyType: st.none() | st.booleans() | st.integers(-5, 5) | st.floats(-9, 9) | _TEXT,
}
