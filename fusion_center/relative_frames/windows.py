"""Report events: which reports of all sources are fused together, and when.

A window gathers at most one report of each source. It is complete when no other source is due
soon; and it ends before a source in it reports again. So every report is fused in exactly one
event, with what others saw nearest to it, and the events depend on what was said of which instant
and not on how time was cut into Closed messages.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from schemas.messages import SourceReport

from ..navigation import NS
from ..state import CarrierState, State
from ..timeline import Instant

SOON, OVERDUE = 0.5, 2.5
"""Periods since its last report from which a source is waited for, and until which."""


def closes(state: State, instant: Instant) -> bool:
    """Whether a source of the window reports again at this instant."""
    return any(
        isinstance(message, SourceReport) and f"{message.carrier}/{message.stream}" in state.window
        for message in instant.messages
    )


def is_full(state: State) -> bool:
    """Whether nobody is waited for who would belong to this window."""
    carriers = {source.partition("/")[0] for source in state.window}
    if state.own not in carriers or len(carriers) < 2:
        return False
    return all(source in state.window for source in _due(state))


def is_event(state: State) -> bool:
    """Whether the window holds reports of two carriers."""
    return len({source.partition("/")[0] for source in state.window}) > 1


def emptied(state: State) -> State:
    """The state with a new window."""
    return replace(state, window={})


def _due(state: State) -> Iterator[str]:
    """Sources whose next report belongs to the present window."""
    now_ns = max(state.window.values())
    for name in (state.own, *state.links):
        carrier = state.carriers.get(name, CarrierState())
        if not carrier.boot or carrier.lost:
            continue
        for source, properties in state.sources(name).items():
            logs = carrier.logs.get(source)
            since = (now_ns - logs.report_t_ns) * NS / properties.period_s if logs else SOON
            if properties.coordinates != "bearing" and SOON <= since < OVERDUE:
                yield f"{name}/{source}"
