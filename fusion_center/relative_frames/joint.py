"""One report event: frames are searched for until one can be trusted, then followed together.

tracks of all carriers at one instant
  -> frames carried on to it
  -> search for those not yet known (association and registration at once)
  -> targets in common, in own axes
  -> all frames improved by their plots; the alarm
  -> estimates, and how far each correction has come
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

import numpy as np
from msgspec.structs import replace

from estimation.relative_frame.range_errors import RangeErrors

from ..quality import Tally
from ..state import Frames, State
from ..timeline import Instant
from . import finding, following, frames, windows
from .links import navigated, obstacle
from .moment import Moment
from .views import View, in_own_plane, view, with_plots_used, with_ranges


def ended(state: State, instant: Instant, tally: Tally) -> State:
    """The state before an instant at which a source of the window reports again: that ends it."""
    return _fused(state, tally) if windows.closes(state, instant) else state


def completed(state: State, tally: Tally) -> State:
    """The state after an instant; a window for which nobody is waited any longer is fused."""
    return _fused(state, tally) if windows.is_full(state) else state


def _fused(state: State, tally: Tally) -> State:
    """One report event: the state after what its window holds has been fused."""
    moment = _moment(state, max(state.window.values())) if windows.is_event(state) else None
    if moment is None:
        return windows.emptied(state)
    state = replace(state, frames=moment.frames)
    known = tuple(name for name in moment.names if state.links[name].followed)
    with np.errstate(all="ignore"):  # numbers from the wire may be anything within its bounds
        state = following.with_scan(state, moment, known, tally) if known else state
        for name in moment.names:
            state = state if name in known else finding.with_search(state, moment, name, tally)
    return windows.emptied(with_plots_used(state, (state.own, *moment.names)))


def _moment(state: State, t_ns: int) -> Moment | None:
    """The event, or None where nobody can take part."""
    heard = sorted({source.partition("/")[0] for source in state.window} - {state.own})
    names = tuple(name for name in heard if name in state.links)
    names = tuple(name for name in names if obstacle(state, name, t_ns) is None)
    if not names:
        return None
    placed = {}
    for name in names:
        with suppress(np.linalg.LinAlgError, ValueError), np.errstate(all="ignore"):
            placed[name] = navigated(state, name, t_ns)
    known = frames.carried_to(state, t_ns)
    ranges = {name: _ranges(state, known, name) for name in (state.own, *placed)}
    return Moment(
        t_ns=t_ns,
        names=tuple(placed),
        own=in_own_plane(_view(state, state.own, t_ns, ranges), None),
        others={n: in_own_plane(_view(state, n, t_ns, ranges), placed[n][0]) for n in placed},
        ranges=ranges,
        between={name: between for name, (between, _) in placed.items()},
        prior={name: prior for name, (_, prior) in placed.items()},
        frames=known,
    )


def _ranges(state: State, known: Frames | None, name: str) -> dict[str, RangeErrors]:
    """What is to be added to the ranges of each source of a carrier."""
    return {
        source: frames.range_errors(state, known, name, source) for source in state.sources(name)
    }


def _view(state: State, name: str, t_ns: int, ranges: Mapping[str, dict[str, RangeErrors]]) -> View:
    """The tracks of a carrier, by what is known of its range errors."""
    followed = frames.ranging_source(state, name)
    return with_ranges(view(state, name, t_ns), ranges[name], followed)
