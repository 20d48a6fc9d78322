"""How far a correction has come: observing, candidate, applied, suspended, with hysteresis.

Everything counts *report events*, registrations made because both carriers had news; how the time
was cut into Closed messages makes no difference. What keeps a carrier from being registered at all
(`off`, or suspended by an operator or a loss) stands above this and is decided in `links`.

A registration is *good* when every direction of (q, D) is determined and its chi2 is not excessive.

    observing   some direction is not determined yet
    candidate   all are; applied after `apply_after` good ones in a row
    applied     the last good estimate holds over `leave_after - 1` undetermined or
                `suspend_after - 1` excessive ones, then observing or suspended
    suspended   chi2 was excessive while applied; good ones lead back as from candidate
"""

from __future__ import annotations

from schemas.messages import Direction

from ..settings import MonitorSettings
from ..state import Estimate, Monitor

MAX_REASON = 400


def after_registration(
    before: Monitor,
    found: Estimate | None,
    settings: MonitorSettings,
    why_none: str = "no pair of logs",
    remark: str = "",
) -> tuple[Monitor, bool]:
    """The monitor after one report event, and whether its estimate is to replace the former one.

    While applied, an estimate that is not good does not: the last good one holds.

    Args:
        found: None where nothing came of it, for the reason `why_none`.
        remark: why a direction is open, where the geometry says it.
    """
    open_question = _open_question(found, remark) if found else why_none
    alarm = _alarm(found, settings) if found else ""
    if open_question:
        return _undetermined(before, open_question, settings)
    if alarm:
        return _excessive(before, alarm, settings)
    good = before.good + 1
    if before.state == "applied" or good >= settings.apply_after:
        return Monitor(state="applied", reason="", good=good), True
    reason = f"every direction determined in {good} of {settings.apply_after} reports"
    return Monitor(state="candidate", reason=reason, good=good), True


def _undetermined(before: Monitor, reason: str, settings: MonitorSettings) -> tuple[Monitor, bool]:
    count = before.undetermined + 1
    if before.state == "applied" and count < settings.leave_after:
        held = f"the last good estimate holds: {reason}"
        return _held(before, held, count, before.excessive), False
    return Monitor(state="observing", reason=reason, undetermined=count), True


def _excessive(before: Monitor, reason: str, settings: MonitorSettings) -> tuple[Monitor, bool]:
    count = before.excessive + 1
    if before.state == "applied" and count < settings.suspend_after:
        held = f"the last good estimate holds: {reason}"
        return _held(before, held, before.undetermined, count), False
    if before.state in ("applied", "suspended"):
        return Monitor(state="suspended", reason=reason, excessive=count), True
    return Monitor(state="candidate", reason=reason, excessive=count), True


def _held(before: Monitor, reason: str, undetermined: int, excessive: int) -> Monitor:
    """Still applied; both counts go on until a good estimate ends them."""
    return Monitor(
        state="applied",
        reason=reason,
        good=before.good,
        undetermined=undetermined,
        excessive=excessive,
    )


def _open_question(found: Estimate, remark: str) -> str:
    """What the data leave open, in words; empty when every direction is determined."""
    weakest = found.directions[0]
    if weakest.status == "determined":
        return ""
    return "; ".join(part for part in (sentence(weakest), remark) if part)


def sentence(direction: Direction) -> str:
    """How far a direction is determined, in words."""
    return f"{direction.name} is {direction.status}: {direction.ratio:.2g} of the prior sigma"


def is_excessive(found: Estimate, settings: MonitorSettings) -> bool:
    """Whether the pairs cannot be believed to agree."""
    return bool(_alarm(found, settings))


def jumped(reason: str) -> Monitor:
    """After an alarm: what was applied holds no longer, and is to be found anew."""
    return Monitor(state="suspended", reason=reason)


def _alarm(found: Estimate, settings: MonitorSettings) -> str:
    """Why the pairs cannot be believed to agree, in words; empty when they do."""
    from scipy.special import chdtri  # 0.1 s, kept out of the start

    if not found.dof:
        return ""
    limit = float(chdtri(found.dof, settings.chi2_false_alarm))
    if found.chi2 <= limit:
        return ""
    return f"chi2 {found.chi2:.4g} of {found.dof} degrees of freedom is above {limit:.4g}"
