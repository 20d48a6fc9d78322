"""The bus in memory: its faults befall samples as asked for, and the same way every time."""

import threading
import time
from collections import Counter
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.bus.faults import HELD_BACK_S, Faults
from schemas.bus.interface import Inbox, Sample
from schemas.bus.memory_bus import MemoryNetwork
from schemas.qos import DATA
from tests.schemas.bus.bus_networks import eventually, take

COUNT = 2000
THREE_SIGMA = 3 * (0.25 / COUNT) ** 0.5  # of a share among COUNT draws, at its widest


def arrivals(network: MemoryNetwork, count: int = COUNT) -> list[int]:
    """Numbers 0 .. count - 1 sent over a network, in the order they arrive."""
    sender, receiver = network.bus("sender"), network.bus("receiver")
    inbox: Inbox[Sample] = Inbox()
    receiver.subscribe("n", inbox)
    for number in range(count):
        sender.publish("n", str(number).encode(), "", DATA)
    assert eventually(lambda: not network.under_way)
    return [int(sample.payload) for sample in inbox.take()]


def test_without_faults_all_arrive_at_once_and_in_order() -> None:
    with MemoryNetwork() as network:
        assert arrivals(network) == list(range(COUNT))


def test_the_asked_share_is_lost() -> None:
    with MemoryNetwork(seed=1, loss=0.2) as network:
        got = arrivals(network)
    assert len(set(got)) == len(got)
    assert len(got) / COUNT == pytest.approx(0.8, abs=THREE_SIGMA)


def test_the_asked_share_arrives_twice() -> None:
    with MemoryNetwork(seed=1, duplicate=0.3) as network:
        times = Counter(arrivals(network))
    assert set(times) == set(range(COUNT))
    assert set(times.values()) == {1, 2}
    assert sum(n == 2 for n in times.values()) / COUNT == pytest.approx(0.3, abs=THREE_SIGMA)


def test_samples_held_back_are_overtaken_and_none_is_lost() -> None:
    with MemoryNetwork(seed=1, reorder=0.1) as network:
        got = arrivals(network)
    assert sorted(got) == list(range(COUNT))
    overtaken = sum(later < earlier for earlier, later in pairwise(got))
    assert 0 < overtaken < 0.15 * COUNT


def test_delayed_samples_arrive_no_earlier() -> None:
    with MemoryNetwork(seed=1, delay_s=(0.02, 0.03)) as network:
        sender, receiver = network.bus("sender"), network.bus("receiver")
        inbox: Inbox[Sample] = Inbox()
        receiver.subscribe("n", inbox)
        begun_s = time.monotonic()
        sender.publish("n", b"", "", DATA)
        assert inbox.take() == []
        assert len(take(inbox, 1)) == 1
        assert time.monotonic() - begun_s >= 0.02


def test_the_same_seed_loses_the_same_and_another_one_other_samples() -> None:
    def got(seed: int) -> list[int]:
        with MemoryNetwork(seed, loss=0.3, duplicate=0.1) as network:
            return arrivals(network, 200)

    assert got(1) == got(1)
    assert got(1) != got(2)


def test_what_other_senders_do_meanwhile_changes_nothing() -> None:
    def got(noisy: bool) -> list[int]:
        with MemoryNetwork(3, loss=0.3) as network:
            other = network.bus("other")
            inbox: Inbox[Sample] = Inbox()
            other.subscribe("**", inbox)
            stop = threading.Event()

            def chatter() -> None:
                while not stop.is_set():
                    other.publish("m", b"", "", DATA)

            thread = threading.Thread(target=chatter)
            if noisy:
                thread.start()
            numbers = arrivals(network, 300)
            stop.set()
            if noisy:
                thread.join()
            return numbers

    assert got(noisy=True) == got(noisy=False)


def test_what_a_session_sends_itself_is_never_lost() -> None:
    with MemoryNetwork(loss=1.0) as network:
        bus = network.bus("a")
        inbox: Inbox[Sample] = Inbox()
        bus.subscribe("n", inbox)
        bus.publish("n", b"", "", DATA)
        assert len(inbox.take()) == 1


def test_faults_can_change_in_the_middle() -> None:
    with MemoryNetwork(loss=1.0) as network:
        sender, receiver = network.bus("a"), network.bus("b")
        inbox: Inbox[Sample] = Inbox()
        receiver.subscribe("n", inbox)
        sender.publish("n", b"lost", "", DATA)
        network.faults = Faults()
        sender.publish("n", b"found", "", DATA)
        assert [sample.payload for sample in inbox.take()] == [b"found"]


def test_a_lost_question_is_waited_for_in_vain() -> None:
    with MemoryNetwork(query_loss=1.0) as network:
        network.bus("server").serve("q", lambda question: [Sample(question.key, b"", "")])
        begun_s = time.monotonic()
        assert network.bus("asker").query("q", b"", "", 0.1) == []
        assert time.monotonic() - begun_s >= 0.1


def test_some_questions_get_through_when_asked_again() -> None:
    with MemoryNetwork(seed=1, query_loss=0.5) as network:
        network.bus("server").serve("q", lambda question: [Sample(question.key, b"", "")])
        asker = network.bus("asker")
        answered = [bool(asker.query("q", b"", "", 0.02)) for _ in range(30)]
    assert 5 < sum(answered) < 25


def test_what_is_under_way_to_a_dead_or_cut_process_is_lost() -> None:
    with MemoryNetwork(delay_s=(0.05, 0.05)) as network:
        sender = network.bus("sender")
        inboxes: dict[str, Inbox[Sample]] = {n: Inbox() for n in ("dead", "cut", "well")}
        for name, inbox in inboxes.items():
            network.bus(name).subscribe("n", inbox)
        sender.publish("n", b"", "", DATA)
        network.kill("dead")
        network.cut("cut")
        assert len(take(inboxes["well"], 1)) == 1
        assert eventually(lambda: not network.under_way)
        assert len(inboxes["dead"]) == len(inboxes["cut"]) == 0


def test_a_cut_takes_all_sessions_of_a_process() -> None:
    with MemoryNetwork() as network:
        control, data, other = network.bus("a"), network.bus("a"), network.bus("b")
        network.cut("a")
        assert [bus.link_up() for bus in (control, data, other)] == [False, False, True]


def test_a_closed_network_leaves_no_thread() -> None:
    before = threading.active_count()
    network = MemoryNetwork(delay_s=(10.0, 10.0))
    a, b = network.bus("a"), network.bus("b")
    b.subscribe("n", Inbox())
    b.serve("q", lambda _: [])
    a.publish("n", b"", "", DATA)
    network.close()
    assert eventually(lambda: threading.active_count() == before)


@given(st.floats(0, 1), st.floats(0, 1), st.randoms())
def test_a_sample_arrives_at_most_twice_and_without_delay_at_once(loss, duplicate, draw) -> None:
    delays_s = Faults(loss=loss, duplicate=duplicate).delays_s(draw)
    assert len(delays_s) <= 2
    assert set(delays_s) <= {0.0}
    if loss == 0 and duplicate == 0:
        assert len(delays_s) == 1


@given(st.floats(0, 1), st.floats(0, 1), st.randoms())
def test_a_delay_lies_between_its_bounds(least_s, more_s, draw) -> None:
    for delay_s in Faults(delay_s=(least_s, least_s + more_s), reorder=1.0).delays_s(draw):
        assert least_s <= delay_s - HELD_BACK_S + 1e-9
        assert delay_s - HELD_BACK_S <= least_s + more_s + 1e-9
