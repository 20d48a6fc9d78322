"""A test class for publishers' own suites, for pytest or unittest."""

from __future__ import annotations

from collections.abc import Iterable

from .. import codec, keys
from ..bus.interface import Sample
from ..errors import WireError
from .checker import Conformance
from .findings import Finding


class ConformanceTests:
    """Inherit, say what your publisher sends, and every finding is a failed test.

    Attributes:
        allowed: codes of findings that your publisher means to have.
    """

    allowed: Iterable[str] = ()

    def samples(self) -> Iterable[Sample]:
        """Everything one life of the publisher sends, from its first message on."""
        raise NotImplementedError("say what your publisher sends")

    def test_publisher_conforms(self) -> None:
        """Nothing is wrong with what is sent."""
        wrong = [finding for finding in self.findings() if finding.code not in self.allowed]
        lines = [f"{f.severity} {f.code} of {f.carrier} {f.source}, {f.count} times: {f.example}. "
                 f"{f.advice}" for f in wrong]  # fmt: skip
        assert not wrong, "\n".join(lines)  # noqa: S101 (it is a test)

    def findings(self) -> list[Finding]:
        """What a listener finds who hears each message at the instant it is stamped."""
        samples = list(self.samples())
        assert samples, "no samples"  # noqa: S101
        conformance = Conformance(samples[0].key.split("/")[2])
        for sample in samples:
            conformance.take(sample, _stamp_s(sample))
        return conformance.findings()


def _stamp_s(sample: Sample) -> float:
    try:
        topic = keys.parse(sample.key).topic
        message = codec.decode(topic.message, sample.payload, sample.encoding)
    except WireError:
        return 0.0
    return getattr(message, "t_ns", 0) * 1e-9
