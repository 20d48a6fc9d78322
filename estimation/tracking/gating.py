"""Which plots may be of which tracks: a search in a plane, before any algebra of pairs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from estimation.arrays import Array, Indices
from estimation.tracking.imm import Bank
from estimation.tracking.innovations import Common
from estimation.tracking.measurements import Measurement, Probe, longest_axis

_WIDTH, _FEW = 2.0, 500  # ratio of reaches looked up together, and tracks that always are


def near(
    bank: Bank, plots: Measurement, gate: float, common: Common | None = None
) -> tuple[Indices, Indices]:
    """Pairs (track, plot), by track then plot, that hold every pair within the ellipse of `gate`.

    Each track looks within the circle round its ellipse, in the plane where that circle holds the
    least area; tracks of about the same reach are looked up together.

    Args:
        bank: predicted to the scan.
        plots: of the scan.
        gate: Mahalanobis distance squared.
        common: error shared by the plots.
    """
    none = np.empty(0, dtype=np.intp)
    if not plots.size or not bank.model.shape[-1]:
        return none, none
    centre, covariance, apart = _ellipses(bank, plots, common)
    probes = plots.probes(centre, covariance)
    reaches = [np.sqrt(gate * each.spread) + apart * each.scale for each in probes]
    areas = [reach**2 * each.area for reach, each in zip(reaches, probes, strict=True)]
    choice = np.argmin(areas, axis=0)
    found = [
        pairs
        for k, (each, reach) in enumerate(zip(probes, reaches, strict=True))
        for pairs in _looked_up(each, reach, np.flatnonzero(choice == k))
    ]
    track, plot = (np.concatenate(ends) for ends in zip(*found, strict=True))
    order = np.lexsort((plot, track))
    return track[order], plot[order]


def _ellipses(bank: Bank, plots: Measurement, common: Common | None) -> tuple[Array, Array, Array]:
    """Places (2, n), covariances (2, 2, models, n) and how far models are from that place (n,)."""
    centre, covariance = bank.mean[:2, 1], bank.covariance[:2, :2]
    apart = np.hypot(*(bank.mean[:2, 0] - centre))
    late = float(np.abs(plots.offset_s).max())
    if late:
        apart = apart + late * np.hypot(*bank.mean[2:]).max(axis=0)
        covariance = 2.0 * (covariance + late**2 * bank.covariance[2:, 2:])
    if common is not None:
        away = np.hypot(*(centre - common.pivot_m[:, None]))
        shared = longest_axis(common.covariance[:2, :2]) + away**2 * common.covariance[2, 2]
        covariance = covariance + 2.0 * np.eye(2)[:, :, None, None] * shared
    return centre, covariance, apart


def _looked_up(probe: Probe, reach: Array, members: Indices) -> list[tuple[Indices, Indices]]:
    """Pairs of some of the tracks, each no farther apart than its reach."""
    if not members.size:
        return []
    finite = np.flatnonzero(np.isfinite(probe.places).all(axis=-1))
    tree = cKDTree(probe.places[finite])
    pairs = [_within(probe, tree, reach, members[group]) for group in _groups(reach[members])]
    return [(track, probe.plot[finite[place]]) for track, place in pairs]


def _groups(reach: Array) -> Iterator[Indices]:
    """Rows of about the same reach, or of a few whatever their reach."""
    order = np.argsort(reach, kind="stable")
    ascending, begin = reach[order], 0
    while begin < len(order):
        alike = int(np.searchsorted(ascending, _WIDTH * ascending[begin]))
        end = max(alike, begin + _FEW)
        yield order[begin:end]
        begin = end


def _within(
    probe: Probe, places: cKDTree, reach: Array, members: Indices
) -> tuple[Indices, Indices]:
    farthest = float(reach[members].max())
    tracks = cKDTree(probe.tracks[members])
    found = tracks.sparse_distance_matrix(places, farthest, output_type="ndarray")
    track = members[found["i"]]
    inside = np.flatnonzero(found["v"] <= reach[track])
    return track[inside], found["j"][inside]
