"""Which plots may be of which tracks: a search in the plane, before any algebra of pairs."""

from __future__ import annotations

import numpy as np

from estimation.arrays import Array, Indices
from estimation.assignment import neighbours
from estimation.tracking.imm import Bank
from estimation.tracking.innovations import Common
from estimation.tracking.measurements import Measurement, longest_axis

_WIDTH = 4.0  # ratio of reaches searched together


def near(
    bank: Bank, plots: Measurement, gate: float, common: Common | None = None
) -> tuple[Indices, Indices]:
    """Pairs (track, plot), by track then plot, that hold every pair within the ellipse of `gate`.

    Each track looks within the circle round its covariance ellipse, widened by the largest noise
    of a plot; tracks of about the same reach are looked up together.

    Args:
        bank: predicted to the scan.
        plots: of the scan.
        gate: Mahalanobis distance squared.
        common: error shared by the plots.
    """
    if not plots.size or not bank.model.shape[-1]:
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
    centre, reach = _circles(bank, plots, gate, common)
    probe = plots.probe(centre)
    reach = np.hypot(reach * probe.scale, np.sqrt(gate) * probe.sigma)
    track, plot = _within(probe.tracks, probe.plots, reach)
    apart = np.hypot(*(probe.tracks[track] - probe.plots[plot]).T)
    inside = apart <= reach[track]
    return track[inside], plot[inside]


def _circles(
    bank: Bank, plots: Measurement, gate: float, common: Common | None
) -> tuple[Array, Array]:
    """Centres (2, n) and radii (n,) [m] that cover the ellipses of both models of each track."""
    centre = bank.mean[:2, 1]
    widest = longest_axis(bank.covariance[:2, :2]).max(axis=0)
    late = float(np.abs(plots.offset_s).max())
    if late:
        widest = (np.sqrt(widest) + late * np.sqrt(_fastest(bank))) ** 2
    if common is not None:
        away = np.hypot(*(centre - common.pivot_m[:, None]))
        q, turn = common.covariance[:2, :2], common.covariance[2, 2]
        widest = widest + 2.0 * (longest_axis(q) + away**2 * turn)
    split = np.hypot(*(bank.mean[:2, 0] - centre))
    drift = late * np.hypot(*bank.mean[2:]).max(axis=0)
    return centre, np.sqrt(gate * widest) + split + drift


def _fastest(bank: Bank) -> Array:
    """Largest variance of a velocity component, over the models."""
    most: Array = longest_axis(bank.covariance[2:, 2:]).max(axis=0)
    return most


def _within(tracks: Array, plots: Array, reach: Array) -> tuple[Indices, Indices]:
    """Pairs no farther apart than the largest reach of the track's group, by track then plot."""
    group = np.floor(np.log(reach / reach.min()) / np.log(_WIDTH)).astype(np.intp)
    found = [_looked_up(tracks, plots, np.flatnonzero(group == g), reach) for g in np.unique(group)]
    if len(found) == 1:
        return found[0]
    track, plot = (np.concatenate(ends) for ends in zip(*found, strict=True))
    order = np.argsort(track, kind="stable")
    return track[order], plot[order]


def _looked_up(
    tracks: Array, plots: Array, members: Indices, reach: Array
) -> tuple[Indices, Indices]:
    track, plot = neighbours(tracks[members], plots, float(reach[members].max()))
    return members[track], plot
