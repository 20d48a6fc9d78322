"""What Foxglove's published JSON Schemas demand of the messages we write, in our own words.

Every field listed is required there. Written from https://docs.foxglove.dev/docs/visualization/
message-schemas; the exporter makes its schemas from its types, so this is the other opinion.
"""

from typing import Any

NUMBER = {"type": "number"}
TEXT = {"type": "string"}
FLAG = {"type": "boolean"}
WHOLE = {"type": "integer", "minimum": 0}


def record(**fields: Any) -> dict[str, Any]:
    return {"type": "object", "properties": fields, "required": list(fields)}


def many(of: dict[str, Any], **more: int) -> dict[str, Any]:
    return {"type": "array", "items": of, **more}


def one_of(*values: int) -> dict[str, Any]:
    return {"enum": list(values)}


TIME = record(sec=WHOLE, nsec={**WHOLE, "maximum": 999_999_999})
VECTOR = record(x=NUMBER, y=NUMBER, z=NUMBER)
TURN = record(x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
POSE = record(position=VECTOR, orientation=TURN)
PART = {**NUMBER, "minimum": 0, "maximum": 1}
COLOUR = record(r=PART, g=PART, b=PART, a=PART)
SOLID = record(pose=POSE, size=VECTOR, color=COLOUR)
LINE = record(
    type=one_of(0, 1, 2), pose=POSE, thickness=NUMBER, scale_invariant=FLAG, points=many(VECTOR),
    color=COLOUR, colors=many(COLOUR), indices=many(WHOLE),
)  # fmt: skip
WRITING = record(
    pose=POSE, billboard=FLAG, font_size=NUMBER, scale_invariant=FLAG, color=COLOUR, text=TEXT
)
NOTHING = many({}, maxItems=0)
ENTITY = record(
    timestamp=TIME, frame_id=TEXT, id=TEXT, lifetime=TIME, frame_locked=FLAG,
    metadata=many(record(key=TEXT, value=TEXT)), arrows=NOTHING, cubes=many(SOLID),
    spheres=many(SOLID), cylinders=NOTHING, lines=many(LINE), triangles=NOTHING,
    texts=many(WRITING), models=NOTHING,
)  # fmt: skip
DELETION = record(timestamp=TIME, type=one_of(0, 1), id=TEXT)
TRANSFORM = record(
    timestamp=TIME, parent_frame_id=TEXT, child_frame_id=TEXT, translation=VECTOR, rotation=TURN
)
SCHEMAS = {
    "foxglove.SceneUpdate": record(deletions=many(DELETION), entities=many(ENTITY)),
    "foxglove.FrameTransforms": record(transforms=many(TRANSFORM)),
    "foxglove.LocationFix": record(
        timestamp=TIME, frame_id=TEXT,
        latitude={**NUMBER, "minimum": -90, "maximum": 90},
        longitude={**NUMBER, "minimum": -180, "maximum": 180}, altitude=NUMBER,
        position_covariance=many(NUMBER, minItems=9, maxItems=9),
        position_covariance_type=one_of(0, 1, 2, 3),
    ),
    "foxglove.Log": record(
        timestamp=TIME, level=one_of(0, 1, 2, 3, 4, 5), message=TEXT, name=TEXT, file=TEXT,
        line=WHOLE,
    ),
}  # fmt: skip
