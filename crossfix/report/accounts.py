"""What a recording counts and tells of the run itself: losses, news, pace."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct

from schemas import keys
from schemas.messages import Event, ProcessState, StreamStatistics

from .story import Story

COUNTED = ("received", "duplicates", "gaps", "gave_up", "late", "rejected", "unclaimed")
"""What the fusion centre counts of every stream."""


class News(Struct, frozen=True, kw_only=True):
    """Something that happened, and when."""

    t_s: float
    text: str


class LossFigures(Struct, frozen=True, kw_only=True):
    """What did not arrive, arrived late or was refused.

    Attributes:
        totals: over all streams; `gaps` were fetched again, `gave_up` were never had.
        queue_drops: between bus and process.
        recorder: dropped, and gaps it could not fill.
        streams: as the fusion centre counted them.
        flags: what looked wrong with a source, and at how many Closed messages.
        unreadable: recorded messages that are not valid.
    """

    totals: dict[str, int]
    queue_drops: dict[str, int]
    recorder: dict[str, int]
    streams: list[StreamStatistics]
    flags: dict[str, int]
    unreadable: int

    @property
    def lost(self) -> int:
        """Messages that were sent and have not been fused, or not been recorded."""
        never = sum(self.totals[name] for name in ("gave_up", "rejected", "unclaimed"))
        return never + sum(self.queue_drops.values()) + sum(self.recorder.values())


class TimingFigures(Struct, frozen=True, kw_only=True):
    """How fast the run was, by the wall clock of the fusion centre.

    Attributes:
        wall_s: from its first sign of life to its last.
        steps_per_s: mean; slowest_steps_per_s: of any second or so.
        load: mean share of the wall time spent in fusing.
    """

    wall_s: float | None
    steps_per_s: float | None
    slowest_steps_per_s: float | None
    load: float | None


def loss_figures(story: Story) -> LossFigures:
    """By the last word of the fusion centre, and of the recorder where it left one."""
    last = story.health[-1] if story.health else None
    streams = list(last.streams) if last else []
    end = story.summary.end
    return LossFigures(
        totals={name: sum(getattr(s, name) for s in streams) for name in COUNTED},
        queue_drops=dict(last.queue_drops) if last else {},
        recorder={"dropped": end.dropped, "gaps": end.gaps} if end else {},
        streams=streams,
        flags={f"{c}/{s}: {flag}": n for (c, s, flag), n in sorted(story.flags.items())},
        unreadable=story.unreadable,
    )


def news(story: Story) -> list[News]:
    """What the fusion centre and its operators said of the run, in order."""
    said = [
        News(t_s=story.step_s(health.step), text=text)
        for health in story.health
        for text in health.news
    ]
    done = [News(t_s=story.step_s(event.step), text=_order(event)) for event in story.events]
    return sorted([*said, *done], key=lambda item: item.t_s)


def _order(event: Event) -> str:
    """What an operator did, in words."""
    parts = ("operator:", event.kind, event.carrier, event.setting, " with ".join(event.pair))
    value = "" if event.value is None else f"= {event.value}"
    return " ".join(filter(None, (*parts, value)))


def timing_figures(story: Story) -> TimingFigures:
    """By the beats and the health of the fusion centre."""
    beats = story.states.get(centre_of(story), ())
    loads = [health.load for health in story.health[1:]]
    load = float(np.mean(loads)) if loads else None
    paces = [pace for _, pace in paces_of(beats)]
    if not paces:
        return TimingFigures(wall_s=None, steps_per_s=None, slowest_steps_per_s=None, load=load)
    wall_s = (beats[-1].t_ns - beats[0].t_ns) * 1e-9
    return TimingFigures(
        wall_s=wall_s,
        steps_per_s=(beats[-1].step - beats[0].step) / wall_s,
        slowest_steps_per_s=min(paces),
        load=load,
    )


def centre_of(story: Story) -> str:
    """The process that fuses."""
    return story.health[-1].centre if story.health else keys.FUSION


def paces_of(beats: Sequence[ProcessState]) -> list[tuple[int, float]]:
    """Wall clock [ns] of each beat, and steps per second since the one before."""
    return [
        (after.t_ns, (after.step - before.step) / ((after.t_ns - before.t_ns) * 1e-9))
        for before, after in pairwise(beats)
        if after.t_ns > before.t_ns and after.boot == before.boot
    ]
