"""Matching of keys agrees with Zenoh's own."""

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from schemas.bus.key_expressions import intersects
from schemas.errors import WireError

plain_chunks = st.sampled_from(["a", "b", "@a", "@b"])
plain_keys = st.lists(plain_chunks, min_size=1, max_size=6).map("/".join)
expressions = st.lists(plain_chunks | st.sampled_from(["*", "**"]), min_size=1, max_size=6).map(
    lambda chunks: str(zenoh.KeyExpr.autocanonize("/".join(chunks)))
)


@given(expressions, expressions)
def test_intersects_as_zenoh_does(one: str, other: str) -> None:
    assert intersects(one, other) == zenoh.KeyExpr(one).intersects(other)


@given(expressions, plain_keys)
def test_a_plain_key_matches_where_zenoh_includes_it(expression: str, key: str) -> None:
    assert intersects(expression, key) == zenoh.KeyExpr(expression).includes(key)


@given(expressions, expressions)
def test_the_order_does_not_matter(one: str, other: str) -> None:
    assert intersects(one, other) == intersects(other, one)


@given(expressions)
def test_an_expression_meets_itself(expression: str) -> None:
    assert intersects(expression, expression)


@pytest.mark.parametrize("bad", ["", "/", "a/", "/a", "a//b", "a*", "a$*", "a?x", "a#x", "***"])
def test_what_is_no_key_expression_is_refused(bad: str) -> None:
    with pytest.raises(WireError):
        intersects(bad, "a")
    with pytest.raises(WireError):
        intersects("a", bad)
