"""Corrections that come back to a carrier: which one it applies at a step, and what comes of it.

In lock-step that is the one of `WINDOW` steps before, for which the step waits: the world has
granted it only because the fusion centre is past that one, so the correction has been sent. Else
it is the newest that has come.
"""

from __future__ import annotations

from schemas import keys
from schemas.bus.ledger import StreamKey
from schemas.bus.recovery import Gap
from schemas.feedback import WINDOW, applied, corrected
from schemas.messages import Correction, Input, Navigation

MOST_KEPT = 128


class Corrections:
    """The corrections of one life of a carrier, by the step of the Closed they belong to."""

    def __init__(self, carrier: str) -> None:
        self._stream = keys.CORRECTION.template.format(centre=keys.FUSION, carrier=carrier)
        self._by_step: dict[int, Correction] = {}

    def note(self, correction: Correction) -> None:
        """Take one in; of too many the newest stay."""
        self._by_step.setdefault(correction.step, correction)
        if len(self._by_step) > MOST_KEPT:
            del self._by_step[min(self._by_step)]

    def newest(self) -> Correction | None:
        """What holds now where nobody waits."""
        return self._by_step[max(self._by_step)] if self._by_step else None

    def missing(self, step: int, first_step: int) -> list[Gap]:
        """What a step in lock-step still waits for; older corrections are forgotten.

        Args:
            first_step: of this life; what was found of an earlier one is not waited for.
        """
        needed = step - WINDOW
        self._by_step = {k: kept for k, kept in self._by_step.items() if k >= needed}
        if needed < first_step or needed in self._by_step:
            return []
        return [(StreamKey(keys.FUSION, "", self._stream), needed, needed)]

    def of(self, step: int) -> Correction | None:
        """The one for a step in lock-step."""
        return self._by_step.get(step - WINDOW)

    def clear(self) -> None:
        """A new life begins."""
        self._by_step.clear()


class Newest:
    """Applies the newest correction that has come to all that a carrier says.

    For carriers that answer no steps; nothing is applied before their first Navigation.
    """

    def __init__(self) -> None:
        self._correction: Correction | None = None
        self._own: Navigation | None = None
        self._errs_since_ns = 0

    def note(self, correction: Correction) -> None:
        """Take one in; one that is older than the last is left aside."""
        if self._correction is None or correction.step > self._correction.step:
            self._correction = correction

    def corrected(self, message: Input) -> Input:
        """What the carrier is about to say, in its corrected frame."""
        if isinstance(message, Navigation):
            self._navigated(message)
        if self._own is None:
            return message
        held = applied(self._correction, self._own, self._errs_since_ns)
        return corrected(message, held)

    def _navigated(self, own: Navigation) -> None:
        """A fix brings another error than before, unless the error of its fixes is constant."""
        renewed = own.kind == "fix" and own.correlation_time_s > 0
        if self._own is None or renewed:
            self._errs_since_ns = own.t_ns
        self._own = own
