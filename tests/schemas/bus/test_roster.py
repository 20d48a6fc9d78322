"""Who is lost and who only seems to be: laws of the roster in made-up time."""

from __future__ import annotations

from schemas import keys
from schemas.bus.interface import Liveness
from schemas.bus.roster import GRACE_S, RELINK_S, Life, Roster

ALPHA = Life("alpha", "b1")


def token(alive: bool, *, link_up: bool = True, life: Life = ALPHA) -> Liveness:
    return Liveness(keys.alive("r", *life), alive, link_up)


def test_a_token_that_goes_while_the_link_stands_is_a_loss_after_a_moment() -> None:
    roster = Roster()
    assert roster.update([token(True)], True, 0.0) == []
    assert roster.has("alpha")
    assert roster.update([token(False)], True, 10.0) == []
    assert roster.update([], True, 10.0 + GRACE_S * 1.01) == [ALPHA]
    assert not roster.has("alpha")


def test_a_token_that_comes_back_within_the_moment_was_never_gone() -> None:
    roster = Roster()
    roster.update([token(True)], True, 0.0)
    assert roster.update([token(False), token(True)], True, 10.0) == []
    assert roster.update([], True, 20.0) == []
    assert roster.boots("alpha") == ["b1"]


def test_a_lost_link_takes_tokens_with_it_and_they_have_time_to_return() -> None:
    roster = Roster()
    roster.update([token(True)], True, 0.0)
    assert roster.update([token(False, link_up=False)], False, 10.0) == []
    assert roster.update([], False, 100.0) == []
    assert roster.update([], True, 101.0) == []
    assert roster.update([], True, 101.0 + RELINK_S * 0.9) == []
    assert roster.update([token(True)], True, 101.0 + RELINK_S * 0.95) == []
    assert roster.update([], True, 120.0) == []


def test_a_token_still_absent_after_the_link_is_back_is_a_loss() -> None:
    roster = Roster()
    roster.update([token(True)], True, 0.0)
    roster.update([token(False, link_up=False)], False, 10.0)
    roster.update([], True, 12.0)
    assert roster.update([], True, 12.0 + RELINK_S * 1.01) == [ALPHA]


def test_the_link_may_be_found_lost_a_moment_after_the_token() -> None:
    roster = Roster()
    roster.update([token(True)], True, 0.0)
    assert roster.update([token(False)], True, 10.0) == []
    assert roster.update([], False, 10.05) == []
    assert roster.update([], True, 12.0) == []
    assert roster.update([token(True)], True, 12.5) == []
    assert roster.update([], True, 30.0) == []


def test_two_processes_with_one_name_are_seen_as_two() -> None:
    roster = Roster()
    second = Life("alpha", "b2")
    roster.update([token(True), token(True, life=second)], True, 0.0)
    assert roster.boots("alpha") == ["b1", "b2"]
    roster.update([token(False)], True, 1.0)
    assert roster.update([], True, 2.0) == [ALPHA]
    assert roster.has("alpha")


def test_what_is_no_token_is_ignored() -> None:
    roster = Roster()
    assert roster.update([Liveness("crossfix/@v1/r/alive/x", True, True)], True, 0.0) == []
    assert roster.present == set()
