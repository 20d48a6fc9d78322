"""What CZML demands of the packets we write, in our own words.

From the CZML Guide (https://github.com/AnalyticalGraphicsInc/czml-writer/wiki): a document is a
list of packets, the first of which describes it. Here nothing is allowed that we do not write.
"""

from typing import Any

NUMBER = {"type": "number"}
TEXT = {"type": "string"}
INSTANT = {"type": "string", "pattern": r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?Z$"}
SPAN = {"type": "string", "pattern": r"^\d{4}[^/]*Z/\d{4}[^/]*Z$"}
BYTE = {"type": "integer", "minimum": 0, "maximum": 255}


def record(required: tuple[str, ...], **fields: Any) -> dict[str, Any]:
    return {
        "type": "object", "properties": fields, "required": list(required),
        "additionalProperties": False,
    }  # fmt: skip


COLOUR = record(("rgba",), rgba={"type": "array", "items": BYTE, "minItems": 4, "maxItems": 4})
MATERIAL = record(("solidColor",), solidColor=record(("color",), color=COLOUR))
SAMPLED = record(("epoch", "number"), epoch=INSTANT, number={"type": "array", "items": NUMBER})
DOCUMENT = record(
    ("id", "version", "clock"),
    id={"const": "document"},
    name=TEXT,
    version={"const": "1.0"},
    clock=record(
        ("interval", "currentTime"),
        interval=SPAN,
        currentTime=INSTANT,
        multiplier=NUMBER,
        range={"enum": ["UNBOUNDED", "CLAMPED", "LOOP_STOP"]},
        step={"enum": ["SYSTEM_CLOCK", "SYSTEM_CLOCK_MULTIPLIER", "TICK_DEPENDENT"]},
    ),
)
PACKET = record(
    ("id", "availability"),
    id=TEXT,
    name=TEXT,
    availability=SPAN,
    position=record(
        ("epoch", "cartographicDegrees"),
        epoch=INSTANT,
        interpolationAlgorithm={"enum": ["LINEAR", "LAGRANGE", "HERMITE"]},
        cartographicDegrees={"type": "array", "items": NUMBER, "minItems": 4},
    ),
    point=record((), pixelSize=NUMBER, color=COLOUR),
    path=record((), width=NUMBER, leadTime=NUMBER, material=MATERIAL),
    label=record(
        ("text",),
        text=TEXT,
        font=TEXT,
        fillColor=COLOUR,
        horizontalOrigin={"enum": ["LEFT", "CENTER", "RIGHT"]},
        pixelOffset=record(
            ("cartesian2",),
            cartesian2={"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2},
        ),
    ),
    ellipse=record(
        ("semiMajorAxis", "semiMinorAxis"),
        semiMajorAxis=SAMPLED,
        semiMinorAxis=SAMPLED,
        rotation=SAMPLED,
        height=NUMBER,
        material=MATERIAL,
    ),
    polyline=record(
        ("positions",),
        positions=record(
            ("cartographicDegrees",),
            cartographicDegrees={"type": "array", "items": NUMBER, "minItems": 6},
        ),
        width=NUMBER,
        material=MATERIAL,
    ),
)
