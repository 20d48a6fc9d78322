"""How long a process goes on without its hub."""

from __future__ import annotations

from ..errors import BusError

HUB_TIMEOUT_S = 120.0
"""A hub that was only started anew is back within seconds, one whose machine was within a minute
or two; for one that stays away nobody is to wait for ever."""


class HubPatience:
    """Watches one's own link to the hub; time is passed in.

    Args:
        timeout_s: that the link may be down without a break.
    """

    def __init__(self, timeout_s: float = HUB_TIMEOUT_S) -> None:
        self._timeout_s = timeout_s
        self._down_s: float | None = None
        self._over = False

    def is_over(self, link_up: bool, now_s: float) -> bool:
        """Whether the hub has been away for too long; once it has, that stays so."""
        if link_up:
            self._down_s = None
        elif self._down_s is None:
            self._down_s = now_s
        self._over = self._over or (
            self._down_s is not None and now_s - self._down_s >= self._timeout_s
        )
        return self._over

    def require(self) -> None:
        """Nothing, as long as the hub has not been given up.

        Raises:
            BusError: it has.
        """
        if self._over:
            raise BusError(
                f"the hub has been away for {self._timeout_s:g} s",
                expected="it to come back, or a longer --hub-timeout",
            )
