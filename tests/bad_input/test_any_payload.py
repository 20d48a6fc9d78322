"""Whatever bytes come under whatever key: one verdict, never an exception."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import msgpack
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_center.process.ingest import Ingest
from schemas import keys
from schemas.bus.interface import Sample
from schemas.conformance import Conformance
from schemas.errors import WireError
from schemas.messages import COLUMNS, Navigation, SourceReport
from schemas.received import receive

RUN = "any"
NUMBERS = st.one_of(st.integers(-(2**63), 2**64 - 1), st.floats(width=64), st.booleans(), st.none())
TEXTS = st.text(max_size=8) | st.sampled_from(["alpha", "b", "radar", "navigation"])
VALUES = st.recursive(
    NUMBERS | TEXTS | st.binary(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=3),
    max_leaves=8,
)
FIELDS = st.sampled_from([*COLUMNS, *SourceReport.__struct_fields__, *Navigation.__struct_fields__])
MAPS = st.dictionaries(FIELDS | TEXTS, VALUES, max_size=8)
ENVELOPE = {"carrier": "alpha", "boot": "b", "stream": "radar", "seq": 1, "t_ns": 1}
PAYLOADS = st.one_of(
    st.binary(max_size=60),
    MAPS.map(msgpack.packb),
    MAPS.map(lambda fields: msgpack.packb({**ENVELOPE, **fields})),
)
KEYS = st.one_of(
    st.sampled_from([topic.template for topic in keys.TOPICS]).map(
        lambda template: f"{keys.PREFIX}/{RUN}/"
        + template.replace("{carrier}", "alpha").replace("{source}", "radar")
        .replace("{process}", "alpha").replace("{centre}", "fusion").replace("{player}", "p")
    ),
    st.text(max_size=40),
    st.text(max_size=20).map(lambda tail: f"{keys.PREFIX}/{RUN}/{tail}"),
)  # fmt: skip
ENCODINGS = st.sampled_from(["", "application/msgpack;crossfix.SourceReport", "application/json"])
SAMPLES: st.SearchStrategy[Any] = st.builds(Sample, KEYS, PAYLOADS, ENCODINGS)


@given(SAMPLES)
@settings(max_examples=200)
def test_a_sample_is_understood_or_refused(sample: Sample) -> None:
    with suppress(WireError):
        address, message = receive(sample)
        assert isinstance(message, address.topic.message)


@given(st.lists(SAMPLES, min_size=1, max_size=5))
@settings(max_examples=80)
def test_ingest_counts_each_once(samples: list[Sample]) -> None:
    ingest = Ingest()
    for sample in samples:
        ingest.accept(sample)
    rows = ingest.statistics()
    assert sum(row.received + row.duplicates + row.rejected for row in rows) == len(samples)


@given(st.lists(SAMPLES, min_size=1, max_size=5))
@settings(max_examples=80)
def test_the_checker_says_something_of_everything(samples: list[Sample]) -> None:
    conformance = Conformance(RUN)
    for sample in samples:
        conformance.take(sample, 1.0)
    assert all(finding.advice for finding in conformance.findings())
    conformance.sigma_checks()
