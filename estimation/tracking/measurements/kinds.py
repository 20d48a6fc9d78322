"""What every kind of measurement gives: rows, places, and where to look."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from estimation.arrays import Array, Indices


class Row(NamedTuple):
    """One scalar equation for each of k pairs, under each model.

    Attributes:
        gradient: (4, 2, k) of the predicted value by the state.
        residual: (2, k) measured less predicted.
        variance: (2, k) of the measurement alone.
        log_reference: (k,) added to the logarithm of the density, see `RangeRate`.
    """

    gradient: Array
    residual: Array
    variance: Array
    log_reference: Array | float = 0.0


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


class Probe(NamedTuple):
    """A plane in which plots near a track can be looked up, and how far to look.

    Attributes:
        plots: (m, 2); tracks: (n, 2).
        sigma: (n,) largest standard deviation of the noise there, as seen from each track.
        scale: (n,) of that plane by metres at the track.
    """

    plots: Array
    tracks: Array
    sigma: Array
    scale: Array


class Measurement(Protocol):
    """The plots of one scan."""

    @property
    def size(self) -> int:
        """Number of plots."""

    @property
    def offset_s(self) -> Array:
        """(m,) instant of each plot less that of the scan."""

    def rows(self, mean: Array, plot: Indices) -> list[Row]:
        """Equations of pairs: states (4, 2, k) predicted to the scan, plots (k,)."""

    def found(self) -> Found | None:
        """Where the plots alone put their targets; None if they fix no place."""

    def beside(self, mean: Array) -> list[Row]:
        """What each plot says beside the place: states (4, 2, m) that began with the plots."""

    def probe(self, place_m: Array) -> Probe:
        """Where to look for plots of tracks at (2, n)."""
