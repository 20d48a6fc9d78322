"""Queries on the bus in memory: who was asked, who has answered, who no longer can."""

from __future__ import annotations

import threading
from collections.abc import Collection
from queue import SimpleQueue

from .answering import answers
from .interface import Handler, Sample


class Question:
    """One query under way; over when nobody is left who could still answer."""

    def __init__(self, sample: Sample) -> None:
        self.sample = sample
        self._answers: list[Sample] = []
        self._asked: set[Server] = set()
        self._changed = threading.Condition()

    def expect(self, server: Server) -> None:
        """Wait for this one too."""
        with self._changed:
            self._asked.add(server)

    def take(self, server: Server, answer: Sample) -> None:
        """One reply; ignored if it comes from one that was given up."""
        with self._changed:
            if server in self._asked:
                self._answers.append(answer)

    def done(self, server: Server) -> None:
        """This one has said all it will."""
        with self._changed:
            self._asked.discard(server)
            self._changed.notify_all()

    def keep(self, servers: Collection[Server]) -> None:
        """Wait no longer for any but these."""
        with self._changed:
            self._asked.intersection_update(servers)
            self._changed.notify_all()

    def wait(self, timeout_s: float) -> list[Sample]:
        """The replies, as soon as there will be no more, or at the end of the time."""
        with self._changed:
            self._changed.wait_for(lambda: not self._asked, timeout_s)
            self._asked.clear()
            return self._answers


class Server:
    """A handler and the thread it answers in."""

    def __init__(self, key: str, handler: Handler) -> None:
        self.key, self._handler = key, handler
        self._questions: SimpleQueue[Question | None] = SimpleQueue()
        threading.Thread(target=self._work, name=f"serve {key}", daemon=True).start()

    def ask(self, question: Question) -> None:
        """Have it answered when its turn comes."""
        self._questions.put(question)

    def close(self) -> None:
        """Answer no more."""
        self._questions.put(None)

    def _work(self) -> None:
        while (question := self._questions.get()) is not None:
            for answer in answers(self._handler, question.sample):
                question.take(self, answer)
            question.done(self)
