"""What every kind of measurement gives: its readings, and what a target should give instead."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from estimation.arrays import Array

PLACE_ROWS = 2
"""As many readings fix a place, if the plots fix one; what follows is said beside it."""


class Readings(NamedTuple):
    """What m plots say, a row for each quantity.

    Attributes:
        value: (rows, m); nan: the plot does not have it (then it is in no pair, or, beside the
            place, says nothing).
        covariance: (rows, rows, m) of its noise.
        angle: for each row whether a turn more is the same.
        log_reference: (rows,) added to the logarithm of the density of each, see `RangeRate`.
        offset_s: (m,) instant of each plot less that of the scan; sigma_offset_s: (m,).
    """

    value: Array
    covariance: Array
    angle: tuple[bool, ...]
    log_reference: tuple[float, ...]
    offset_s: Array
    sigma_offset_s: Array

    def beside(self) -> Readings:
        """The rows that say something beside the place."""
        rest = slice(PLACE_ROWS, None)
        return self._replace(
            value=self.value[rest],
            covariance=self.covariance[rest, rest],
            angle=self.angle[rest],
            log_reference=self.log_reference[rest],
        )


class Expected(NamedTuple):
    """What targets in n states under each model should give.

    Attributes:
        value: (rows, 2, n).
        gradient: (rows, 4, 2, n) by the state.
    """

    value: Array
    gradient: Array

    def beside(self) -> Expected:
        """The rows that say something beside the place."""
        return Expected(self.value[PLACE_ROWS:], self.gradient[PLACE_ROWS:])


class Found(NamedTuple):
    """Where n plots alone put their targets.

    Attributes:
        place_m: (2, n) east, north.
        covariance_m2: (2, 2, n).
        area: (n,) m^2 in the plane for one unit of measurement space.
    """

    place_m: Array
    covariance_m2: Array
    area: Array


class Measurement(Protocol):
    """The plots of one scan."""

    @property
    def size(self) -> int:
        """Number of plots."""

    @property
    def offset_s(self) -> Array:
        """(m,) instant of each plot less that of the scan."""

    def readings(self) -> Readings:
        """What they say."""

    def expected(self, mean: Array, offset_s: Array | float) -> Expected:
        """What targets of states (4, 2, n) give `offset_s` (n,) later."""

    def found(self) -> Found | None:
        """Where the plots alone put their targets; None if they fix no place."""
