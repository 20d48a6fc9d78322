"""What operators order, taken into the state: suspended corrections, bound pairs, settings."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec.structs import replace

from schemas.errors import SettingsError
from schemas.messages import Command, Event

from .settings import Settings, with_setting
from .state import Link, Monitor, Orders, State


def refusal(settings: Settings, order: Command | Event) -> str:
    """Why an order cannot be carried out, in words; empty when it can.

    For whoever turns commands into events, so that an operator is told at once; the pipeline
    leaves out what is refused here.
    """
    if order.kind in ("suspend", "resume"):
        return "" if order.carrier else f"{order.kind}: which carrier?"
    if order.kind in ("bind", "forbid"):
        named = len(order.pair) == 2 and all(len(t.split("/", 2)) == 3 for t in order.pair)
        return "" if named else f"{order.kind}: need two tracks as carrier/source/track_id"
    if order.setting == "own":
        return "set: the own carrier is the gauge of a run and stays"
    try:
        with_setting(settings, order.setting, order.value)
    except SettingsError as error:
        return str(error)
    return ""


def carry_out(state: State, events: Iterable[Event]) -> State:
    """The state after the events of a Closed, in order; one seen before changes nothing."""
    for event in events:
        if event.seq > state.orders.seq:
            state = replace(state, orders=replace(state.orders, seq=event.seq))
            if not refusal(state.settings, event):
                state = _carry_out(state, event)
    return state


def _carry_out(state: State, event: Event) -> State:
    if event.kind == "set":
        return replace(state, settings=with_setting(state.settings, event.setting, event.value))
    if event.kind in ("suspend", "resume"):
        return _suspend(state, event.carrier or "", event.kind == "suspend")
    pair = (min(event.pair), max(event.pair))
    bound = tuple(p for p in state.orders.bound if p != pair)
    forbidden = tuple(p for p in state.orders.forbidden if p != pair)
    most = state.settings.association.max_orders
    if event.kind == "bind":
        bound = (*bound, pair)[max(0, len(bound) + 1 - most) :]
    else:
        forbidden = (*forbidden, pair)[max(0, len(forbidden) + 1 - most) :]
    return replace(state, orders=replace(state.orders, bound=bound, forbidden=forbidden))


def _suspend(state: State, carrier: str, suspended: bool) -> State:
    """Suspend or resume; a correction that is resumed has to earn its state again."""
    others = tuple(c for c in state.orders.suspended if c != carrier)
    orders: Orders = replace(state.orders, suspended=(*others, carrier) if suspended else others)
    links = dict(state.links)
    if carrier in links:
        links[carrier] = replace(links.get(carrier, Link()), monitor=Monitor())
    return replace(state, orders=orders, links=links)
