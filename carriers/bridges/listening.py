"""The way out: messages of a run as JSON lines, by the names that `jsonl` reads."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from schemas import codec, keys
from schemas.bus.interface import Bus, Inbox, Sample
from schemas.errors import CrossfixError, WireError

from .run_clock import RunClock
from .run_watch import RunWatch

WAIT_S = 0.1
TOPICS = ("report", "navigation", "correction", "track")
"""What is printed unless topics are named."""


class Listener:
    """Follows topics of a run until its world has left.

    Attributes:
        refused: messages that were none.
    """

    def __init__(self, bus: Bus, run: str, topics: Iterable[keys.Topic]) -> None:
        self.refused = 0
        self._inbox: Inbox[Sample] = Inbox()
        for topic in topics:
            bus.subscribe(topic.every(run), self._inbox)
        self._watch = RunWatch(bus, run, RunClock(None))

    @property
    def drops(self) -> int:
        """Messages that were too many."""
        return self._inbox.drops

    def lines(self) -> Iterator[bytes]:
        """What has come, a line each; waits a moment for something."""
        for sample in self._inbox.take(WAIT_S):
            try:
                yield line_of(sample)
            except WireError:
                self.refused += 1

    def is_over(self, now_s: float) -> bool:
        """Whether the run has ended."""
        return self._watch.is_over(now_s)


def line_of(sample: Sample) -> bytes:
    """One message as one line of JSON: its topic, then its fields.

    Raises:
        WireError: it is none.
    """
    topic = keys.parse(sample.key).topic
    message = codec.decode(topic.message, sample.payload, sample.encoding)
    return b'{"topic":"%s",%s' % (topic.name.encode(), codec.encode_json(message)[1:])


def topic_of(name: str) -> keys.Topic:
    """The topic of a name.

    Raises:
        CrossfixError: no such topic; lists them.
    """
    topics = {topic.name: topic for topic in keys.TOPICS}
    if name not in topics:
        raise CrossfixError("no such topic", got=name, expected=" or ".join(topics))
    return topics[name]
