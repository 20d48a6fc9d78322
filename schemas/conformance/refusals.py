"""Why a message was refused, told as its author would understand it."""

from __future__ import annotations

import re
from collections.abc import Callable
from math import pi
from typing import Any, NamedTuple

from ..errors import WireError
from . import raw as reading

ANGLES = ("bearing_rad", "elevation_rad", "sigma_bearing_rad", "sigma_elevation_rad")
COORDINATES = ("latitude_rad", "longitude_rad", "heading_rad")
FULL_TURN_DEG = 360.0
_INDEX = re.compile(r"\[\d+\]|\[\.\.\.\]")
_FIELD = re.compile(r"`\$\.?([^`]*)`")


class Refusal(NamedTuple):
    """A code, which field where that matters, and the case in words."""

    code: str
    detail: str
    example: str


def of_sample(error: WireError, payload: bytes, encoding: str) -> Refusal:
    """What was wrong with a sample that was refused with an error."""
    text = str(error)
    for words, code in (
        ("too large", "size"),
        ("disagree", "envelope"),
        ("may be called so", "name"),
    ):
        if words in text:
            return Refusal(code, "", text)
    raw = reading.unpacked(payload, encoding)
    if raw is None:
        if "json" in encoding and re.search(rb"\bNaN\b|\bInfinity\b", payload):
            return Refusal("not_finite", "", "JSON has no NaN or Infinity")
        return Refusal("payload", "", _no_map(payload, encoding, text))
    return _of_map(raw, text)


def _of_map(raw: dict[str, Any], text: str) -> Refusal:
    looks: dict[str, Callable[[dict[str, Any]], str]] = {
        "degrees": _degrees,
        "not_finite": reading.not_finite,
        "ragged": reading.ragged,
        "sigma_zero": _sigma_zero,
    }
    for code, look in looks.items():
        if example := look(raw):
            return Refusal(code, "", example)
    return _by_field(raw, text)


def _by_field(raw: dict[str, Any], text: str) -> Refusal:
    found = _FIELD.search(text)
    field = _INDEX.sub("[]", found[1]) if found else ""
    if "positive definite" in text or "elements, expected" in text:
        return Refusal("covariance", "", text)
    if raw.get("seq") == 0:
        return Refusal("seq_start", "", "seq is 0")
    if field == "t_ns" and isinstance(raw.get("t_ns"), float):
        return Refusal("time_unit", "", f"t_ns is the float {raw['t_ns']!r}")
    return Refusal("schema", field, text)


def _no_map(payload: bytes, encoding: str, text: str) -> str:
    if payload.lstrip()[:1] in (b"{", b"[") and "json" not in encoding:
        return f"looks like JSON, but its encoding is {encoding or 'not set'}"
    return text


def _degrees(raw: dict[str, Any]) -> str:
    """An angle that cannot be radians and can be degrees."""
    pose = raw.get("pose")
    for name in (*ANGLES, *COORDINATES):
        limit = pi / 2 if name == "latitude_rad" else 2 * pi
        values = reading.cells(raw, name)
        if isinstance(pose, dict) and isinstance(pose.get(name), int | float):
            values.append(float(pose[name]))
        worst = max(values, key=abs, default=0.0)
        if limit + 1e-9 < abs(worst) <= FULL_TURN_DEG:
            return f"{name} is {worst:.6g}, which looks like degrees"
    return ""


def _sigma_zero(raw: dict[str, Any]) -> str:
    for name in raw:
        if name.startswith("sigma_") and 0.0 in reading.cells(raw, name):
            return f"{name} holds 0"
    return ""
