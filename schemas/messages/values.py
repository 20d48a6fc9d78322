"""The kinds of value a field may hold: bounded, finite, and refused by the codec otherwise.

A bound makes `msgspec` refuse NaN and the infinities as well: neither compares as within it.
"""

from __future__ import annotations

from math import pi
from typing import Annotated

from msgspec import Meta

_TURN = 2 * pi + 1e-9

Id = Annotated[str, Meta(pattern=r"^[a-z0-9_-]{1,32}$(?!\n)")]
"""Name of a run, carrier, source, process or boot."""
Text = Annotated[str, Meta(max_length=1024)]
"""Free text for people, and names that other systems give."""
Count = Annotated[int, Meta(ge=0, le=2**63 - 1)]
"""A counter, a sequence number (from 1; 0 is nothing yet) or a step (from 1)."""
TimeNs = Annotated[int, Meta(ge=0, le=2**63 - 1)]
"""Unix nanoseconds by the sender's own clock."""
Real = Annotated[float, Meta(ge=-1e18, le=1e18)]
"""Any finite number."""
Metres = Annotated[float, Meta(ge=-1e9, le=1e9)]
MetresPerSecond = Annotated[float, Meta(ge=-1e5, le=1e5)]
Seconds = Annotated[float, Meta(ge=-1e6, le=1e6)]
Range = Annotated[float, Meta(ge=0, le=1e9)]
"""Slant range [m]."""
Angle = Annotated[float, Meta(ge=-_TURN, le=_TURN)]
"""Angle within one turn [rad]; a value in degrees seldom passes."""
Latitude = Annotated[float, Meta(ge=-pi / 2, le=pi / 2)]
Longitude = Annotated[float, Meta(ge=-_TURN, le=_TURN)]
Sigma = Annotated[float, Meta(gt=0, le=1e12)]
"""One sigma, in the unit of what it belongs to."""
Variance = Annotated[float, Meta(ge=0, le=1e24)]
Share = Annotated[float, Meta(ge=0, le=1)]
"""A probability or a fraction."""
Triangle = Annotated[list[Real], Meta(max_length=78)]
"""Row-major upper triangle of a symmetric positive definite matrix (12 x 12 at most)."""


def order_of_triangle(length: int) -> int:
    """Order n of the matrix whose upper triangle has `length` elements; 0 where there is none."""
    order = int(((8 * length + 1) ** 0.5 - 1) / 2)
    return order if order * (order + 1) // 2 == length else 0


def is_positive_definite(triangle: list[float]) -> bool:
    """Whether an upper triangle belongs to a positive definite matrix (by its Cholesky factor)."""
    if len(triangle) == 3:  # by far the most frequent
        a, b, c = triangle
        return a > 0 and c - b * (b / a) > 0
    n = order_of_triangle(len(triangle))
    if n == 0:
        return False
    rows = [triangle[i * n - i * (i - 1) // 2 : i * n - i * (i - 1) // 2 + n - i] for i in range(n)]
    for i in range(n):
        pivot = rows[i][0]
        if not pivot > 0:
            return False
        for j in range(1, n - i):
            factor = rows[i][j] / pivot
            rows[i + j] = [a - factor * b for a, b in zip(rows[i + j], rows[i][j:], strict=True)]
    return True


def require_covariance(name: str, triangle: list[float] | None, orders: tuple[int, ...]) -> None:
    """Refuse a triangle that is no covariance of one of the `orders`.

    Raises:
        ValueError: names the field, what was got and what was expected.
    """
    if triangle is None:
        return
    if order_of_triangle(len(triangle)) not in orders:
        sizes = " or ".join(str(n * (n + 1) // 2) for n in orders)
        raise ValueError(f"{name}: got {len(triangle)} elements, expected {sizes}")
    if not is_positive_definite(triangle):
        raise ValueError(f"{name}: not positive definite: {triangle}")
