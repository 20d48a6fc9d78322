"""The wire is open: plain `msgpack` or `json` and the exported schemas are enough to speak it."""

from __future__ import annotations

import json
from typing import Any

import jsonschema  # type: ignore[import-untyped]
import msgpack
import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from schemas import codec, json_schema, keys
from schemas import messages as m
from schemas.errors import WireError
from schemas.fields import fields_of

STRUCTS: list[type[msgspec.Struct]] = [
    t for t in map(m.__dict__.get, m.__all__) if isinstance(t, type)
]
"""Every struct of the wire, travelling alone or inside another."""
FEW = settings(
    max_examples=12, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
every_struct = pytest.mark.parametrize("struct", STRUCTS, ids=lambda s: s.__name__)


def validator(struct: type[msgspec.Struct]) -> Any:
    """Validates what MessagePack gives: there bytes are bytes, not strings in base 64."""
    schema = json_schema.schema_of(struct)
    base = jsonschema.Draft202012Validator
    base.check_schema(schema)
    strings = base.TYPE_CHECKER.redefine("string", lambda _, v: isinstance(v, str | bytes))
    return jsonschema.validators.extend(base, type_checker=strings)(schema)


@every_struct
def test_plain_msgpack_and_the_schema_speak_every_message(
    struct: type[msgspec.Struct], messages_of: Any
) -> None:
    schema = validator(struct)

    @FEW
    @given(messages_of(struct))
    def holds(message: msgspec.Struct) -> None:
        plain = msgpack.unpackb(codec.encode(message))
        schema.validate(plain)
        assert codec.decode(struct, msgpack.packb(plain)) == message

    holds()


@every_struct
def test_plain_json_with_decimal_strings_speaks_every_message(
    struct: type[msgspec.Struct], messages_of: Any
) -> None:
    @FEW
    @given(messages_of(struct))
    def holds(message: msgspec.Struct) -> None:
        plain = _as_strings(json.loads(codec.encode_json(message)))
        assert codec.decode(struct, json.dumps(plain).encode(), "application/json") == message

    holds()


def _as_strings(value: Any, name: str = "") -> Any:
    """What a sender writes whose numbers have 53 bits: stamps and counters as strings."""
    if isinstance(value, dict):
        return {key: _as_strings(item, key) for key, item in value.items()}
    stamped = name.endswith("_ns") or name in ("seq", "step", "first", "last", "last_seq")
    return (
        str(value)
        if stamped and isinstance(value, int)
        else ([_as_strings(item, name) for item in value] if isinstance(value, list) else value)
    )


def test_files_are_current() -> None:
    assert json_schema.stale() == [], "run python -m schemas.json_schema"
    assert json_schema.main(["--check"]) == 0


def test_stale_files_are_named(tmp_path: Any) -> None:
    json_schema.write(tmp_path)
    assert json_schema.stale(tmp_path) == []
    (tmp_path / "Step.json").write_text("{}")
    (tmp_path / "Gone.json").write_text("{}")
    (tmp_path / "Ack.json").unlink()
    assert json_schema.stale(tmp_path) == ["Ack.json", "Gone.json", "Step.json"]
    json_schema.write(tmp_path)
    assert json_schema.stale(tmp_path) == []


@pytest.mark.parametrize("topic", keys.TOPICS, ids=lambda t: t.name)
def test_every_topic_has_a_schema_file_of_this_version(topic: keys.Topic) -> None:
    schema = json.loads(json_schema.exported(topic.message))
    assert schema == json_schema.schema_of(topic)
    assert schema["$id"] == f"urn:crossfix:v1:{topic.message.__name__}"
    assert schema["type"] == "object"
    assert schema["description"]


@every_struct
def test_schema_and_codec_both_refuse_a_missing_field(
    struct: type[msgspec.Struct], messages_of: Any
) -> None:
    schema = validator(struct)

    @FEW
    @given(messages_of(struct), st.data())
    def holds(message: msgspec.Struct, data: st.DataObject) -> None:
        plain = msgpack.unpackb(codec.encode(message))
        required = json_schema.schema_of(struct)["required"]
        del plain[data.draw(st.sampled_from(required))]
        assert not schema.is_valid(plain)
        with pytest.raises(WireError, match=rf"^{struct.__name__}: Object missing required field"):
            codec.decode(struct, msgpack.packb(plain))

    if json_schema.schema_of(struct)["required"]:
        holds()


def test_fields_say_what_the_docstrings_say() -> None:
    fields = {f.name: f for f in fields_of(m.SourceReport)}
    assert list(fields) == list(m.SourceReport.__struct_fields__)
    assert fields["boot"].description.startswith("one life of the sender")  # of the envelope
    assert fields["north_m"].description == fields["east_m"].description != ""
    assert fields["sigma_range_m"].description == "one sigma of range_m."
    assert fields["range_m"][1:4] == ("list of (number >= 0, <= 1e+09 or nil) or nil", "m", "null")
    assert fields["range_rate_mps"].unit == "m/s"
    assert fields["seq"].default is None
    ends = {f.name: f.description for f in fields_of(m.Ranging)}
    assert ends["t_tx_ns"] == "by the sender's clock"
    assert ends["t_rx_ns"] == "by the receiver's."


def test_every_documented_field_exists() -> None:
    """A name before the colon of an Attributes line that is no field would go unread."""
    for struct in STRUCTS:
        attributes = (struct.__doc__ or "").partition("Attributes:\n")[2]
        heads = [line[8:].partition(":")[0] for line in attributes.splitlines() if line[8:9] > " "]
        for name in ", ".join(heads).split(", ") if heads else []:
            assert name in struct.__struct_fields__, f"{struct.__name__}: {name}"


def test_every_number_of_the_wire_is_bounded() -> None:
    """NaN and the infinities pass a number without bounds; only settings may hold anything."""
    for struct in STRUCTS:
        for number in _numbers(json_schema.schema_of(struct)):
            assert {"maximum", "exclusiveMaximum"} & number.keys(), struct.__name__
            assert {"minimum", "exclusiveMinimum"} & number.keys(), struct.__name__


def _numbers(schema: Any) -> list[dict[str, Any]]:
    if isinstance(schema, list):
        return [n for item in schema for n in _numbers(item)]
    if not isinstance(schema, dict):
        return []
    own = [schema] if schema.get("type") == "number" else []
    return own + [n for item in schema.values() for n in _numbers(item)]
