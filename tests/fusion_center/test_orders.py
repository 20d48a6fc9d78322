"""Operators' orders: told at once what cannot be done, carried out once and in order."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace as changed

from fusion_center import pipeline
from fusion_center.orders import carry_out, refusal
from fusion_center.settings import Settings, settings_from
from fusion_center.state import State
from schemas.messages import Command, Event
from tests.fusion_center.scenes import two_ships

A, B, C = "a/radar/t0", "b/radar/t0", "b/radar/odd/name"


def state(**fusion: Any) -> State:
    return pipeline.initial(two_ships(2).scenario(), settings_from(fusion))


def event(seq: int, kind: str, **more: Any) -> Event:
    return Event(centre="fusion", seq=seq, step=1, t_ns=1, id=f"e{seq}", kind=kind, **more)


@pytest.mark.parametrize(
    ("kind", "more", "word"),
    [
        ("suspend", {}, "which carrier"),
        ("bind", {"pair": [A]}, "two tracks"),
        ("bind", {"pair": [A, "b/radar"]}, "two tracks"),
        ("set", {"setting": "association.gat", "value": 3.0}, "association.gate"),
        ("set", {"setting": "association.gate", "value": "x"}, "float"),
        ("set", {"setting": "own", "value": "b"}, "gauge"),
    ],
)
def test_what_cannot_be_done_is_said_in_words(kind: Any, more: dict[str, Any], word: str) -> None:
    assert word in refusal(Settings(), Command(id="1", kind=kind, **more))


@pytest.mark.parametrize(
    ("kind", "more"),
    [
        ("suspend", {"carrier": "b"}),
        ("resume", {"carrier": "b"}),
        ("bind", {"pair": [A, C]}),
        ("set", {"setting": "association.gate", "value": 3}),
    ],
)
def test_what_can_be_done_is_not_refused(kind: Any, more: dict[str, Any]) -> None:
    assert refusal(Settings(), Command(id="1", kind=kind, **more)) == ""


def test_binding_and_forbidding_undo_each_other() -> None:
    bound = carry_out(state(), [event(1, "bind", pair=[B, A])])
    assert bound.orders.bound == ((A, B),)
    forbidden = carry_out(bound, [event(2, "forbid", pair=[A, B])])
    assert (forbidden.orders.bound, forbidden.orders.forbidden) == ((), ((A, B),))
    again = carry_out(forbidden, [event(3, "bind", pair=[A, B])])
    assert (again.orders.bound, again.orders.forbidden) == (((A, B),), ())


def test_an_event_seen_before_changes_nothing() -> None:
    once = carry_out(state(), [event(1, "suspend", carrier="b"), event(2, "resume", carrier="b")])
    assert carry_out(once, [event(1, "suspend", carrier="b")]) == once


@pytest.mark.parametrize(("most", "kept"), [(3, 3), (0, 0)])
def test_orders_are_bounded_and_the_newest_stay(most: int, kept: int) -> None:
    orders = [event(n, "bind", pair=[f"a/radar/t{n}", f"b/radar/t{n}"]) for n in range(1, 9)]
    after = carry_out(state(association={"max_orders": most}), orders)
    numbers = [pair[0].removeprefix("a/radar/t") for pair in after.orders.bound]
    assert numbers == [str(n) for n in range(1, 9)][8 - kept :]


def test_a_setting_takes_effect_and_a_wrong_one_does_not() -> None:
    before = state()
    after = carry_out(before, [event(1, "set", setting="association.gate", value=3)])
    assert after.settings.association.gate == 3.0
    wrong = carry_out(after, [event(2, "set", setting="association.gate", value=-3)])
    assert wrong == changed(after, orders=changed(after.orders, seq=2))
