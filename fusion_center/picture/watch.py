"""Whether what a source claims agrees with the picture: sigma, false plots, names.

Counts are forgotten over about fifty reports, so that a source that mends its ways is believed
again. What is flagged is still fused: the picture weighs plots by what is declared of them, but for
the number of the false ones, which shows by itself.
"""

from __future__ import annotations

import numpy as np

from estimation.tracking.tracker import Association

from ..quality import Look
from ..state import Watched
from .names import Agreement

KEPT = 0.98
"""Of the counts from report to report."""
SETTLED = 10
"""Reports after which a plot of no track is a false one, not a target seen for the first time."""
ENOUGH = 60.0
"""Degrees of freedom on which a verdict rests."""
TOO_SMALL, TOO_LARGE = 2.0, 0.1
"""NIS per degree of freedom out of which a claimed sigma is wrong. A gate of 16 lets none beyond 8
be seen, and plots that lie evenly in it have 4."""
MOST_FALSE, MORE_FALSE = 3.0, 5.0
"""Times the declared number of false plots, and as many more, are too many."""
TAKEN = 0.5
MOST_ASTRAY = 5.0
"""Plots, not forgotten, whose name is that of a target elsewhere: more are no accident."""
WRONG = 0.2
"""Share of the names of a source that are astray, from which none of them is used."""


NO_NAMES = Agreement()


def look(done: Association, dimensions: int) -> Look:
    """What became of the plots of a report.

    Args:
        dimensions: of one plot.
    """
    sure = done.probability > TAKEN
    squared = done.distance[sure]
    squared = squared[np.isfinite(squared)]
    taken = len(set(done.plot[sure].tolist()))
    return Look(taken, len(done.begun) - taken, float(squared.sum()), dimensions * len(squared))


def watched(before: Watched, seen: Look, names: Agreement = NO_NAMES) -> Watched:
    """The counts with one more report."""
    lone = seen.lone if before.reports >= SETTLED else 0
    return Watched(
        reports=before.reports + 1,
        weight=KEPT * before.weight + 1.0,
        lone=KEPT * before.lone + lone,
        nis=KEPT * before.nis + seen.nis,
        dof=KEPT * before.dof + seen.dof,
        named=KEPT * before.named + names.named,
        astray=KEPT * before.astray + names.astray,
    )


def names_are_believed(now: Watched) -> bool:
    """Whether the names of a source say anything of who is who."""
    return now.astray <= max(MOST_ASTRAY, WRONG * now.named)


def false_plots(now: Watched, declared_false: float) -> float:
    """False plots to be expected in a report: as declared, unless there are far more.

    Where sigmas are claimed too small plots miss their tracks, and are not false for that.

    Args:
        declared_false: plots of no target expected in a report.
    """
    missing = now.dof >= ENOUGH and now.nis / now.dof > TOO_SMALL
    return _lone(now) if _are_many(now, declared_false) and not missing else declared_false


def _lone(now: Watched) -> float:
    """Plots of no track in a report."""
    return now.lone / max(now.weight, 1.0)


def _are_many(now: Watched, declared_false: float) -> bool:
    settled = now.reports > 2 * SETTLED
    return settled and _lone(now) > MOST_FALSE * declared_false + MORE_FALSE


def flags(now: Watched, declared_false: float) -> list[str]:
    """What looks wrong with a source, as sentences; the figures are coarse so that they last.

    Args:
        declared_false: plots of no target expected in a report.
    """
    found = []
    if now.dof >= ENOUGH:
        ratio = now.nis / now.dof
        if ratio > TOO_SMALL:
            found.append("plots lie much farther from the tracks than their sigma says")
        if ratio < TOO_LARGE:
            found.append("plots lie much nearer to the tracks than their sigma says")
    if _are_many(now, declared_false):
        found.append(f"far more false plots than the {declared_false:.3g} a report it declares")
    if now.astray > MOST_ASTRAY:
        used = "" if names_are_believed(now) else ": its names are not used"
        found.append(f"names are told of two targets, or of one that is elsewhere{used}")
    return found
