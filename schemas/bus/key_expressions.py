"""Which keys an expression names, by Zenoh's rules, without Zenoh."""

from __future__ import annotations

from functools import lru_cache

from ..errors import WireError

Chunks = tuple[str, ...]


@lru_cache(maxsize=65536)
def intersects(one: str, other: str) -> bool:
    """Whether some key matches both expressions (with a plain key: whether it matches).

    `*` stands for one chunk, `**` for any number of them, neither for a chunk that starts with `@`:
    wildcards do not cross versions.

    Raises:
        WireError: one of them is no key expression.

    Source: Zenoh RFC "Key Expressions", without its `$*`.
    """
    return _intersect(chunks_of(one), chunks_of(other))


def chunks_of(expression: str) -> Chunks:
    """The chunks of a key expression.

    Raises:
        WireError: an empty chunk, a character no key may hold, or a wildcard inside a chunk.
    """
    chunks = tuple(expression.split("/"))
    for chunk in chunks:
        if not chunk or set(chunk) & set("?#$") or ("*" in chunk and chunk not in ("*", "**")):
            raise WireError("no key expression", got=expression[:128], expected="chunk/*/chunk/**")
    return chunks


def _intersect(one: Chunks, other: Chunks) -> bool:
    if not one or not other:
        return all(chunk == "**" for chunk in one + other)
    if other[0] == "**":
        one, other = other, one
    if one[0] == "**":
        skipped = not other[0].startswith("@") and _intersect(one, other[1:])
        return skipped or _intersect(one[1:], other)
    return _meet(one[0], other[0]) and _intersect(one[1:], other[1:])


def _meet(one: str, other: str) -> bool:
    verbatim = one.startswith("@") or other.startswith("@")
    return one == other or (not verbatim and "*" in (one, other))
