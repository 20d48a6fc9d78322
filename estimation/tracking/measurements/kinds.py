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
    """A plane in which plots near n tracks can be looked up, and how far to look.

    Attributes:
        places: (q, 2) where plots are; plot: (q,) which they are (one may be in two places).
        tracks: (n, 2).
        spread: (n,) variance, along its widest direction, of a track less a plot of its target.
        scale: (n,) length there of a metre at the track, at most.
        area: (n,) m^2 at the track of a unit of area there.
    """

    places: Array
    plot: Indices
    tracks: Array
    spread: Array
    scale: Array
    area: Array


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

    def probes(self, place_m: Array, covariance_m2: Array) -> list[Probe]:
        """Ways to look for plots of tracks at (2, n) with covariances (2, 2, models, n)."""
