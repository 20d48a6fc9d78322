"""What a check of the doctor finds."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal, NamedTuple

if TYPE_CHECKING:
    from crossfix.evaluation import FrameSummary

Verdict = Literal["ok", "warn", "bad"]
_ORDER: tuple[Verdict, ...] = ("ok", "warn", "bad")


class Finding(NamedTuple):
    """One line of the doctor's.

    Attributes:
        verdict: with `warn` runs work, but not all of them or not well; with `bad` they do not.
        advice: what to do; empty where all is well.
        frames: errors before and after correction, of the check that runs a scenario.
    """

    what: str
    verdict: Verdict
    found: str
    advice: str = ""
    frames: tuple[FrameSummary, ...] = ()


def judged(
    what: str, value: float, found: str, advice: str, *, warn_below: float, bad_below: float
) -> Finding:
    """A finding of something of which more is better."""
    if value >= warn_below:
        return Finding(what, "ok", found)
    return Finding(what, "bad" if value < bad_below else "warn", found, advice)


def worst(findings: Iterable[Finding]) -> Verdict:
    """The verdict on all of them."""
    return max((finding.verdict for finding in findings), key=_ORDER.index, default="ok")
