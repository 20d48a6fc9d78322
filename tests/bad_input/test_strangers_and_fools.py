"""Whoever shows no token takes no part; whoever does can harm himself only; memory is bounded."""

from __future__ import annotations

import time
from typing import Any

import pytest

from fusion_center.admission.counts import MAX_STRANGE_ROWS
from fusion_center.admission.lives import MAX_LIVES, MAX_STRANGERS, Lives
from fusion_center.admission.steps import refusal
from fusion_center.process.attendance import TWIN_S, Attendance
from fusion_center.process.closing import PATIENCE_S, LockstepClosing, PacedClosing
from fusion_center.process.ingest import Ingest
from schemas import codec, keys
from schemas.bus.interface import Liveness, Sample
from schemas.bus.ledger import MAX_JUMP, MAX_SPANS, StreamKey
from schemas.bus.roster import MAX_PRESENT, Life
from schemas.messages import (
    Closed,
    DeclaredCarrier,
    DeclaredScenario,
    Origin,
    SourceInfo,
    SourceProperties,
    SourceReport,
    Step,
    StreamEnd,
    StreamStatistics,
)

SECOND = 10**9
SCENARIO = DeclaredScenario(
    name="r",
    origin=Origin(latitude_rad=0.7, longitude_rad=0.5),
    epoch_ns=0,
    step_ns=SECOND,
    steps=500,
    carriers=[DeclaredCarrier(name="alpha", sigma_position_m=1.0, sigma_north_rad=0.01)],
)
ALPHA = Life("alpha", "a")


def with_lives(*lives: Life) -> Ingest:
    known = Lives()
    known.show(set(lives), lives)
    return Ingest(known)


def report(life: Life, seq: int, **fields: Any) -> Sample:
    message = SourceReport(
        carrier=life.process, boot=life.boot, stream="radar", seq=seq,
        **{"t_ns": seq * SECOND, **fields},
    )  # fmt: skip
    key = keys.REPORT.key("r", life.process, "radar")
    return Sample(key, codec.encode(message), codec.encoding_of(SourceReport))


def row(ingest: Ingest, carrier: str = "alpha", stream: str = "radar") -> StreamStatistics:
    return next(r for r in ingest.statistics() if (r.carrier, r.stream) == (carrier, stream))


def named(closed: Closed | None) -> list[tuple[str, str, int]]:
    assert closed is not None
    return [(end.carrier, end.boot, end.last_seq) for end in closed.manifest]


# who takes part


def test_a_stranger_is_held_back_until_it_shows_its_token() -> None:
    lives, mallory = Lives(), Life("mallory", "m")
    ingest = Ingest(lives)
    for seq in (1, 2, 4):
        ingest.accept(report(mallory, seq))
    assert ingest.ends(9 * SECOND, only_stepless=True) == []
    assert ingest.gaps() == []
    lives.show({mallory}, [mallory])
    (end,) = ingest.ends(9 * SECOND, only_stepless=True)
    assert end.last_seq == 2
    assert ingest.gaps() == [(StreamKey("mallory", "m", "radar"), 3, 3)]


@pytest.mark.parametrize("lockstep", [True, False])
def test_a_second_process_of_one_name_does_not_begin_the_first_anew(lockstep: bool) -> None:
    """A stray message of another boot used to reset the carrier and to make it late for ever."""
    ingest = with_lives(ALPHA)
    step = 1 if lockstep else 0
    ingest.accept(report(ALPHA, 1, step=step))
    ingest.accept(report(Life("alpha", "stray"), 1))
    closing = LockstepClosing(SCENARIO, ingest) if lockstep else PacedClosing(SCENARIO, ingest, 0.2)
    if isinstance(closing, LockstepClosing):
        end = StreamEnd(carrier="alpha", boot="a", stream="radar", last_seq=1)
        closing.on_closed(Closed(step=1, t_ns=SECOND, joined=["alpha"], manifest=[end]))
    else:
        closing.on_step(Step(boot="w", step=1, t_ns=SECOND, mode="paced"), 0.0)
    assert named(closing.next(1.0)) == [("alpha", "a", 1)]


def test_a_members_answer_alone_speaks_for_it() -> None:
    """Another life with a token under the name of a carrier that answers steps is not added."""
    twin = Life("alpha", "twin")
    ingest = with_lives(ALPHA, twin)
    closing = LockstepClosing(SCENARIO, ingest)
    ingest.accept(report(twin, 1))
    closing.on_closed(Closed(step=1, t_ns=SECOND, joined=["alpha"]))
    assert named(closing.next(1.0)) == []


def test_twins_and_strangers_are_told_once() -> None:
    attendance = Attendance(Lives())
    tokens = [Liveness(keys.alive("r", "alpha", boot), True, True) for boot in ("a", "b")]
    assert attendance.update(tokens, True, 0.0).news == ["carrier alpha has come"]
    assert attendance.update([], True, TWIN_S).news == []
    (told,) = attendance.update([], True, TWIN_S + 0.1).news
    assert told.startswith("2 processes are called alpha, boots a, b")
    assert attendance.update([], True, TWIN_S + 1).news == []
    other, stranger = attendance.strangers([Life("mallory", "m"), ALPHA, Life("alpha", "x")])
    assert other.startswith("another life publishes as alpha")
    assert stranger.startswith("mallory publishes, but shows no liveliness token")
    assert attendance.strangers([Life("mallory", "other")]) == []


def test_a_carrier_back_before_its_loss_was_noticed_is_told_all_the_same() -> None:
    attendance = Attendance(Lives())
    first, second = (keys.alive("r", "alpha", boot) for boot in ("a", "b"))
    attendance.update([Liveness(first, True, True)], True, 0.0)
    attendance.update([Liveness(first, False, True), Liveness(second, True, True)], True, 1.0)
    changes = attendance.update([], True, 2.0)
    (told,) = changes.news
    assert told.startswith("carrier alpha is lost")
    assert (changes.come, changes.gone) == ([], [])


def test_a_strangers_world_token_that_goes_ends_nothing() -> None:
    attendance = Attendance(Lives())
    tokens = [keys.alive("r", keys.WORLD, boot) for boot in ("w", "forged")]
    attendance.update([Liveness(token, True, True) for token in tokens], True, 0.0)
    attendance.update([Liveness(tokens[1], False, True)], True, 1.0)
    assert not attendance.update([], True, 2.0).world_lost
    attendance.update([Liveness(tokens[0], False, True)], True, 3.0)
    assert attendance.update([], True, 4.0).world_lost


# numbers


def test_a_seq_out_of_this_world_is_refused_at_once_and_the_stream_goes_on() -> None:
    ingest = with_lives(ALPHA)
    started_s = time.process_time()
    for seq in (1, 2**62, 2**63 - 1, 2, MAX_JUMP + 3):
        ingest.accept(report(ALPHA, seq, t_ns=SECOND))
    (end,) = ingest.ends(9 * SECOND, only_stepless=False)
    assert time.process_time() - started_s < 0.5
    assert end.last_seq == 2
    assert (row(ingest).received, row(ingest).rejected) == (2, 3)
    assert "seq jumps from 2" in row(ingest).reason


def test_a_stream_met_in_the_middle_of_its_life_is_taken_from_there() -> None:
    ingest = with_lives(ALPHA)
    ingest.accept(report(ALPHA, 10**12, t_ns=1))
    (gap,) = ingest.gaps()
    span = ingest.give_up(gap)
    assert (span.first, span.last) == (1, 10**12 - 1)
    (end,) = ingest.ends(SECOND, only_stepless=False)
    closed = Closed(step=1, t_ns=SECOND, manifest=[end], gave_up=[span])
    assert [message.seq for message in ingest.claim(closed)] == [10**12]


def test_a_stream_of_holes_is_refused_before_it_costs_memory() -> None:
    ingest = with_lives(ALPHA)
    for seq in range(2, 2 * MAX_SPANS + 40, 2):
        ingest.accept(report(ALPHA, seq))
    assert row(ingest).received == MAX_SPANS
    assert "more gaps" in row(ingest).reason


def test_counts_never_overflow_the_wire() -> None:
    ingest = with_lives(ALPHA)
    for _ in range(5):
        ingest.give_up((StreamKey("alpha", "a", "radar"), 1, 2**63 - 1))
    assert codec.decode(StreamStatistics, codec.encode(row(ingest))).gave_up == 2**62


# stamps


@pytest.mark.parametrize("paced", [True, False])
def test_a_stamp_from_the_far_future_is_told_and_does_not_stop_its_stream(paced: bool) -> None:
    ingest = with_lives(ALPHA)
    closing = PacedClosing(SCENARIO, ingest, 0.0) if paced else LockstepClosing(SCENARIO, ingest)
    for seq, t_ns in ((1, SECOND), (2, 2**62), (3, SECOND)):
        ingest.accept(report(ALPHA, seq, t_ns=t_ns))
    if isinstance(closing, LockstepClosing):
        closing.on_closed(Closed(step=1, t_ns=SECOND))
    closing.on_step(Step(boot="w", step=1, t_ns=SECOND, mode="paced"), 0.0)
    closed = closing.next(1.0)
    assert named(closed) == [("alpha", "a", 3)]
    assert closed is not None
    assert len(ingest.claim(closed)) == 3
    assert (row(ingest).rejected, row(ingest).reason) == (
        1, "stamped 4.61e+09 s after the closing: not fused",
    )  # fmt: skip


def test_a_stamp_somewhat_ahead_waits_for_its_time() -> None:
    ingest = with_lives(ALPHA)
    closing = PacedClosing(SCENARIO, ingest, 0.0)
    ingest.accept(report(ALPHA, 1, t_ns=5 * SECOND))
    closing.on_step(Step(boot="w", step=6, t_ns=6 * SECOND, mode="paced"), 0.0)
    named_at = []
    while (closed := closing.next(1.0)) is not None:
        named_at += [closed.step] * len(closed.manifest)
        ingest.claim(closed)
    assert named_at == [4]  # from a second before its stamp on: the error clocks may have


def test_what_a_source_is_never_comes_too_early() -> None:
    ingest = with_lives(ALPHA)
    info = SourceInfo(
        carrier="alpha", boot="a", stream="info", seq=1, t_ns=2**62, source="radar",
        properties=SourceProperties(),
    )  # fmt: skip
    ingest.accept(Sample(keys.SOURCE.key("r", "alpha", "radar"), codec.encode(info), ""))
    assert len(ingest.ends(SECOND, only_stepless=False)) == 1


# names


@pytest.mark.parametrize(
    ("carrier", "source", "word"),
    [
        ("world", "radar", "no carrier"),
        ("alpha", "navigation", "no source"),
        ("alpha", "info", "no"),
    ],
)
def test_names_of_the_run_itself_are_nobodys(carrier: str, source: str, word: str) -> None:
    ingest = with_lives(Life(carrier, "a"))
    message = SourceReport(carrier=carrier, boot="a", stream=source, seq=1, t_ns=1)
    ingest.accept(Sample(keys.REPORT.key("r", carrier, source), codec.encode(message), ""))
    (counts,) = ingest.statistics()
    assert counts.rejected == 1
    assert word in counts.reason


def test_a_source_info_of_another_source_than_its_keys_is_refused() -> None:
    ingest = with_lives(ALPHA)
    info = SourceInfo(
        carrier="alpha", boot="a", stream="info", seq=1, t_ns=1, source="ais",
        properties=SourceProperties(),
    )  # fmt: skip
    ingest.accept(Sample(keys.SOURCE.key("r", "alpha", "radar"), codec.encode(info), ""))
    assert "disagree" in row(ingest, "alpha", "info").reason


# the clock


def test_nobody_stops_the_clock_of_a_paced_run() -> None:
    ingest = with_lives(ALPHA)
    closing = PacedClosing(SCENARIO, ingest, 0.2)
    ingest.accept(report(ALPHA, 5, t_ns=1))
    closing.on_step(Step(boot="w", step=1, t_ns=SECOND, mode="paced"), 0.0)
    assert closing.next(0.2 + PATIENCE_S - 0.01) is None
    assert named(closing.next(0.2 + PATIENCE_S)) == []


def test_forged_closings_and_steps_are_refused_with_the_reason() -> None:
    closing = LockstepClosing(SCENARIO, Ingest())
    assert "closes step 400" in closing.on_closed(Closed(step=400, t_ns=400 * SECOND))
    assert "closes step" in closing.on_closed(Closed(step=2**62, t_ns=0))
    assert "another instant" in closing.on_closed(Closed(step=1, t_ns=5))
    assert closing.on_closed(Closed(step=1, t_ns=SECOND)) == ""
    assert closing.on_closed(Closed(step=1, t_ns=SECOND)) == ""
    assert "otherwise" in closing.on_closed(Closed(step=1, t_ns=SECOND, lost=["alpha"]))
    first = closing.next(0.0)
    assert first is not None
    assert first.lost == []
    assert "of 500" in refusal(Step(boot="w", step=2**62, t_ns=0), SCENARIO)
    assert "another instant" in refusal(Step(boot="w", step=3, t_ns=4), SCENARIO)
    assert refusal(Step(boot="w", step=3, t_ns=3 * SECOND), SCENARIO) == ""


# bounds


def test_a_flood_of_boots_carriers_and_streams_leaves_the_true_one_its_place() -> None:
    ingest = with_lives(ALPHA)
    ingest.accept(report(ALPHA, 1))
    for number in range(3000):
        ingest.accept(report(Life("alpha", f"b{number}"), 1))
        ingest.accept(report(Life(f"c{number}", "b"), 1))
    ingest.accept(report(ALPHA, 2))
    assert [end.last_seq for end in ingest.ends(9 * SECOND, only_stepless=False)] == [2]
    assert len(ingest.waiting()) <= MAX_STRANGERS + 1
    rows = ingest.statistics()
    assert len(rows) <= MAX_STRANGE_ROWS + 1
    assert sum(r.received for r in rows) == 6002
    assert sum(r.unclaimed for r in rows) >= 6000 - MAX_STRANGERS


def test_a_flood_of_tokens_takes_nobodys_place() -> None:
    lives = Lives()
    attendance = Attendance(lives)
    attendance.update([Liveness(keys.alive("r", "alpha", "a"), True, True)], True, 0.0)
    flood = [keys.alive("r", f"c{number}", "b") for number in range(2 * MAX_PRESENT)]
    attendance.update([Liveness(token, True, True) for token in flood], True, 1.0)
    assert ALPHA in lives
    assert len(attendance.here) <= MAX_LIVES
    gone = [Liveness(token, False, True) for token in flood]
    attendance.update(gone, True, 2.0)
    changes = attendance.update([], True, 9.0)
    assert attendance.here == ["alpha"]
    assert len(attendance.lost) <= MAX_LIVES
    assert len(changes.gone) <= MAX_LIVES


def test_one_that_floods_is_refused_beyond_its_share_and_the_others_are_heard() -> None:
    lives = Lives()
    lives.show({ALPHA}, [ALPHA])
    ingest, mallory = Ingest(lives), Life("mallory", "m")
    for seq in range(1, 200):
        ingest.accept(report(mallory, seq, range_m=[1.0] * 1000))
    ingest.accept(report(ALPHA, 1))
    assert row(ingest).received == 1
    stranger = row(ingest, "mallory")
    assert 0 < stranger.received < 100
    assert "no liveliness token" in stranger.reason
