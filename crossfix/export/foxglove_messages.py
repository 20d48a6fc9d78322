"""The messages of Foxglove and Lichtblick that we write: their names, fields and JSON Schemas.

Only the kinds of primitive that are drawn have a type here; lists of the others are empty.
"""

from __future__ import annotations

import json
from functools import cache
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

NANOSECONDS = 10**9


class Time(Struct, frozen=True):
    """An instant since 1970, or a duration."""

    sec: Annotated[int, Meta(ge=0)] = 0
    nsec: Annotated[int, Meta(ge=0, lt=NANOSECONDS)] = 0


class Vector3(Struct, frozen=True):
    """A point or a direction."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class Quaternion(Struct, frozen=True):
    """A rotation."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


class Pose(Struct, frozen=True):
    """A place and a rotation."""

    position: Vector3 = Vector3()
    orientation: Quaternion = Quaternion()


class Color(Struct, frozen=True):
    """Red, green, blue and opacity, each from 0 to 1."""

    r: float
    g: float
    b: float
    a: float = 1.0


class KeyValuePair(Struct, frozen=True):
    """A fact about an entity."""

    key: str
    value: str


class SpherePrimitive(Struct, frozen=True):
    """An ellipsoid; `size` are its full axes."""

    pose: Pose
    size: Vector3
    color: Color


class CubePrimitive(Struct, frozen=True):
    """A box."""

    pose: Pose
    size: Vector3
    color: Color


class LinePrimitive(Struct, frozen=True):
    """Lines; type 0 is a strip, 1 a loop, 2 separate pieces."""

    type: int
    pose: Pose
    thickness: float
    scale_invariant: bool
    points: list[Vector3]
    color: Color
    colors: list[Color] = []
    indices: list[int] = []


class TextPrimitive(Struct, frozen=True):
    """A text that faces the viewer."""

    pose: Pose
    billboard: bool
    font_size: float
    scale_invariant: bool
    color: Color
    text: str


class SceneEntity(Struct, frozen=True, kw_only=True):
    """Something in the scene; a later one of the same id takes its place."""

    timestamp: Time
    frame_id: str
    id: str
    lifetime: Time = Time()
    frame_locked: bool = True
    metadata: list[KeyValuePair] = []
    arrows: list[Any] = []
    cubes: list[CubePrimitive] = []
    spheres: list[SpherePrimitive] = []
    cylinders: list[Any] = []
    lines: list[LinePrimitive] = []
    triangles: list[Any] = []
    texts: list[TextPrimitive] = []
    models: list[Any] = []


class SceneEntityDeletion(Struct, frozen=True):
    """Takes the entities of an id (type 0), or all of the topic (1), out of the scene."""

    timestamp: Time
    type: int
    id: str


class SceneUpdate(Struct, frozen=True):
    """What changes in the scene."""

    deletions: list[SceneEntityDeletion]
    entities: list[SceneEntity]


class FrameTransform(Struct, frozen=True):
    """Where a frame lies in another."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion


class FrameTransforms(Struct, frozen=True):
    """Several transforms."""

    transforms: list[FrameTransform]


class LocationFix(Struct, frozen=True):
    """A place on Earth [deg, m]; the covariance is (east, north, up) by rows [m^2].

    Attributes:
        position_covariance_type: 0 unknown, 3 known.
    """

    timestamp: Time
    frame_id: str
    latitude: float
    longitude: float
    altitude: float
    position_covariance: Annotated[list[float], Meta(min_length=9, max_length=9)]
    position_covariance_type: int


class Log(Struct, frozen=True):
    """A line of a log; level 2 is info, 3 a warning."""

    timestamp: Time
    level: int
    message: str
    name: str
    file: str = ""
    line: Annotated[int, Meta(ge=0)] = 0


Message = SceneUpdate | FrameTransforms | LocationFix | Log


def time_of(t_ns: int) -> Time:
    """Nanoseconds as Foxglove has them."""
    return Time(*divmod(t_ns, NANOSECONDS))


@cache
def schema_of(message: type[Struct]) -> bytes:
    """JSON Schema of a message; every part stands where it is used, as viewers want it."""
    (schema,), parts = msgspec.json.schema_components([message])
    inlined = _inlined(schema, parts)
    inlined["title"] = schema_name(message)
    return json.dumps(inlined).encode()


def schema_name(message: type[Struct]) -> str:
    """By which viewers know it."""
    return f"foxglove.{message.__name__}"


def _inlined(node: Any, parts: dict[str, Any]) -> Any:
    if isinstance(node, list):
        return [_inlined(item, parts) for item in node]
    if not isinstance(node, dict):
        return node
    if "$ref" in node:
        return _inlined(parts[node["$ref"].rsplit("/", 1)[-1]], parts)
    return {name: _inlined(item, parts) for name, item in node.items() if name != "default"}
