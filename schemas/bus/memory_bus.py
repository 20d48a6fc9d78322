"""A bus within one process, and the faults of a real one: how everything is tested without Zenoh.

Each process under test gets its sessions from one network. Samples are lost, doubled, delayed and
reordered by chance, the same way for the same seed; links are cut and processes killed on demand:

    network = MemoryNetwork(seed=1, loss=0.2)
    carrier, fusion = network.bus("alpha"), network.bus("fusion")
    inbox: Inbox[Sample] = Inbox()
    fusion.subscribe(keys.REPORT.every("strait"), inbox)
    carrier.publish(keys.REPORT.key("strait", "alpha", "radar"), payload, encoding, DATA)
    network.cut("alpha")   # its link is down: nothing passes, its token is gone for the others
    network.heal("alpha")
    network.kill("alpha")  # as kill -9; a new bus("alpha") is its next life

The laws it shares with `ZenohBus` are one suite of tests, run against both.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from random import Random

from ..errors import BusError
from ..qos import Qos
from .delayed import Delayed
from .faults import NO_FAULTS, Faults
from .interface import Handler, Inbox, Liveness, Sample
from .key_expressions import chunks_of, intersects
from .limits import require_size, weigh
from .memory_queries import Question, Server


class MemoryNetwork:
    """What the sessions of several processes share, in place of a hub.

    What befalls a sample depends on the seed, who sends it to whom, its key, and how many samples
    came before it on that key from that sender: not on what other threads do meanwhile.

    Attributes:
        faults: may be replaced at any time, and hold from the next sample on.
    """

    def __init__(
        self,
        seed: int = 0,
        *,
        loss: float = 0.0,
        duplicate: float = 0.0,
        delay_s: tuple[float, float] = (0.0, 0.0),
        reorder: float = 0.0,
        query_loss: float = 0.0,
    ) -> None:
        self.faults = Faults(loss, duplicate, delay_s, reorder, query_loss)
        self._seed = seed
        self._lock = threading.RLock()
        self._sessions: list[MemoryBus] = []
        self._cut: set[str] = set()
        self._sent: Counter[tuple[str, str]] = Counter()
        self._questions: dict[Question, MemoryBus] = {}
        self._delayed = Delayed()

    def __enter__(self) -> MemoryNetwork:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def under_way(self) -> int:
        """Delayed samples that have not arrived yet."""
        return len(self._delayed)

    def bus(self, name: str) -> MemoryBus:
        """A new session of the process `name`, which may have several."""
        session = MemoryBus(self, name)
        with self._lock:
            self._sessions.append(session)
        return session

    def cut(self, name: str) -> None:
        """Take a process's link down: what is sent to it and from it meanwhile is lost."""
        with self._lock:
            self._cut.add(name)
            self._settle()

    def heal(self, name: str) -> None:
        """Bring its link back up."""
        with self._lock:
            self._cut.discard(name)
            self._settle()

    def kill(self, name: str) -> None:
        """End a process in the middle of things: its sessions fall silent, its tokens vanish."""
        with self._lock:
            for session in [s for s in self._sessions if s.name == name]:
                self._leave(session)

    def close(self) -> None:
        """Close all sessions and forget what is under way."""
        with self._lock:
            for session in list(self._sessions):
                self._leave(session)
        self._delayed.close()

    def _leave(self, session: MemoryBus) -> None:
        with self._lock:
            if session in self._sessions:
                self._sessions.remove(session)
                for server in session._servers:
                    server.close()
                self._settle()

    def _forget(self, question: Question) -> None:
        with self._lock:
            del self._questions[question]

    def _linked(self, session: MemoryBus) -> bool:
        return session in self._sessions and session.name not in self._cut

    def _reached(self, session: MemoryBus) -> list[MemoryBus]:
        """Whom a session reaches: itself always, the others while both links stand."""
        linked = self._linked(session)
        return [s for s in self._sessions if s is session or (linked and self._linked(s))]

    def _settle(self) -> None:
        """After any change of who is there: tell the watches, release those who wait in vain."""
        for session in self._sessions:
            linked = self._linked(session)
            there = self._tokens(session)
            for watch in session._watches:
                watch.update(there, linked)
        for question, asker in self._questions.items():
            question.keep({server for s in self._reached(asker) for server in s._servers})

    def _tokens(self, viewer: MemoryBus) -> list[str]:
        if not self._linked(viewer):
            return []
        tokens = (token for s in self._reached(viewer) for token in s._tokens)
        return list(dict.fromkeys(tokens))

    def _send(self, sender: MemoryBus, sample: Sample) -> None:
        with self._lock:
            nth = self._count(sender, sample.key)
            for receiver in self._reached(sender):
                if receiver._wants(sample.key):
                    for delay_s in self._delays_s(sender, receiver, sample.key, nth):
                        self._deliver(delay_s, receiver, sample)

    def _count(self, sender: MemoryBus, key: str) -> int:
        self._sent[sender.name, key] += 1
        return self._sent[sender.name, key]

    def _delays_s(self, sender: MemoryBus, receiver: MemoryBus, key: str, nth: int) -> list[float]:
        if sender is receiver or self.faults == NO_FAULTS:
            return [0.0]
        return self.faults.delays_s(self._draw("sample", sender, receiver, key, nth))

    def _draw(
        self, what: str, sender: MemoryBus, receiver: MemoryBus, key: str, nth: int
    ) -> Random:
        return Random(f"{self._seed}/{what}/{sender.name}/{receiver.name}/{key}/{nth}")  # noqa: S311

    def _deliver(self, delay_s: float, receiver: MemoryBus, sample: Sample) -> None:
        if delay_s <= 0.0:
            receiver._take(sample)
        else:
            self._delayed.call(delay_s, lambda: self._arrive(receiver, sample))

    def _arrive(self, receiver: MemoryBus, sample: Sample) -> None:
        with self._lock:
            if self._linked(receiver):
                receiver._take(sample)

    def _ask(self, asker: MemoryBus, question: Question) -> None:
        with self._lock:
            self._questions[question] = asker
            nth = self._count(asker, question.sample.key)
            for owner in self._reached(asker):
                for server in owner._servers:
                    if intersects(server.key, question.sample.key):
                        question.expect(server)
                        if owner is asker or not self._lost(asker, owner, question.sample.key, nth):
                            server.ask(question)

    def _lost(self, asker: MemoryBus, owner: MemoryBus, key: str, nth: int) -> bool:
        return self._draw("query", asker, owner, key, nth).random() < self.faults.query_loss


class MemoryBus:
    """`Bus` on a `MemoryNetwork`; made by its `bus`."""

    def __init__(self, network: MemoryNetwork, name: str) -> None:
        self.name = name
        self._network, self._lock = network, network._lock
        self._subscriptions: list[tuple[str, Inbox[Sample]]] = []
        self._servers: list[Server] = []
        self._tokens: list[str] = []
        self._watches: list[_Watch] = []

    def __enter__(self) -> MemoryBus:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def publish(self, key: str, payload: bytes, encoding: str, qos: Qos) -> None:
        """Send a sample; without delay it is in the inboxes when this returns.

        Raises:
            WireError: the payload is too large, or the key is none.
        """
        del qos  # nothing queues here, so nothing overtakes
        require_size(key, payload)
        chunks_of(key)
        self._network._send(self, Sample(key, payload, encoding))

    def subscribe(self, key_expression: str, inbox: Inbox[Sample]) -> None:
        """Put every sample that matches into the inbox, from now on."""
        chunks_of(key_expression)
        with self._changing():
            self._subscriptions.append((key_expression, inbox))

    def serve(self, key: str, handler: Handler) -> None:
        """Answer queries for `key`, one after the other, in a thread of their own."""
        chunks_of(key)
        with self._changing():
            self._servers.append(Server(key, handler))

    def query(self, key: str, payload: bytes, encoding: str, timeout_s: float) -> list[Sample]:
        """Ask everyone who serves `key`; the replies that came within the time.

        Comes back early, and without an error, when those who have not answered are gone.
        """
        chunks_of(key)
        question = Question(Sample(key, payload, encoding))
        self._network._ask(self, question)
        try:
            return question.wait(timeout_s)
        finally:
            self._network._forget(question)

    @contextmanager
    def announce(self, token: str) -> Iterator[None]:
        """Hold a liveliness token until the context is left or the process dies."""
        chunks_of(token)
        with self._changing():
            self._tokens.append(token)
        try:
            yield
        finally:
            with self._lock:
                if token in self._tokens:
                    self._tokens.remove(token)
                    self._network._settle()

    def watch(self, token_expression: str, inbox: Inbox[Liveness]) -> None:
        """Put every token that is there, comes or goes into the inbox."""
        chunks_of(token_expression)
        with self._changing():
            self._watches.append(_Watch(token_expression, inbox))

    def tokens(self, token_expression: str, timeout_s: float = 1.0) -> list[str]:
        """Tokens that are there now, in order of their names; none while the link is down."""
        del timeout_s  # they are known
        chunks_of(token_expression)
        with self._lock:
            there = self._network._tokens(self)
        return sorted(token for token in there if intersects(token_expression, token))

    def link_up(self) -> bool:
        """Whether the link stands."""
        with self._lock:
            return self._network._linked(self)

    def close(self) -> None:
        """Leave; never raises, and doing it twice does nothing."""
        self._network._leave(self)

    @contextmanager
    def _changing(self) -> Iterator[None]:
        with self._lock:
            if self not in self._network._sessions:
                raise BusError("the bus is closed")
            yield
            self._network._settle()

    def _wants(self, key: str) -> bool:
        return any(intersects(expression, key) for expression, _ in self._subscriptions)

    def _take(self, sample: Sample) -> None:
        for expression, inbox in self._subscriptions:
            if intersects(expression, sample.key):
                inbox.put(sample, weigh(sample.key, sample.payload))


class _Watch:
    """What one watch has told of, so that it tells of changes only."""

    def __init__(self, expression: str, inbox: Inbox[Liveness]) -> None:
        self._expression, self._inbox = expression, inbox
        self._known: set[str] = set()

    def update(self, there: list[str], link_up: bool) -> None:
        """Tell what went and what came."""
        wanted = [token for token in there if intersects(self._expression, token)]
        for token in sorted(self._known.difference(wanted)):
            self._inbox.put(Liveness(token, False, link_up), weigh(token))
        for token in wanted:
            if token not in self._known:
                self._inbox.put(Liveness(token, True, True), weigh(token))
        self._known = set(wanted)
