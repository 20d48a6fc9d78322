"""Nameless bearings of one carrier, made tracks of bearings: which of them are of one target?

A track knows the bearing of its target and, hardly, how far it is: 1 / range and the velocity by
the range, so that what the carrier's own manoeuvres do to the bearing is foreseen as surely as the
range is known. Where bearings are so near to each other that it is open which is whose, none is
taken, and the tracks coast on until they are apart again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.frames import wrap_pi

GATE = 16.0
"""Chi2 of 1 within which a bearing may be of a track."""
OPEN_NATS = 3.0
"""By how much the next best pairing must be less likely for a pair to be sure: one in twenty."""
MATURE = 3
"""Bearings from which a track can be in doubt; younger ones take the likeliest."""
PATIENCE = 8
"""Looks without a bearing after which a track ends."""
OPEN_COUNTS = 3
"""As so many of them counts one at which a bearing was open: what is lost begins anew soon."""
_INVERSE_RANGE, _SIGMA_INVERSE_RANGE = 2e-4, 2e-4  # 1/m: anything beyond 2 km, likely 5 km
_SIGMA_SPEED_MPS = 8.0
_SIGMA_ACCELERATION_MPS2 = 0.1  # of a ship that turns 1 deg/s
_STEPS = np.array([1e-6, 1e-8, 1e-8, 1e-9])  # of the state, for differences


class BearingTracks(NamedTuple):
    """Tracks of bearings, n of them.

    Attributes:
        number: (n,) names; born: how many there have been.
        hits: (n,) bearings; missed: (n,) looks since the last one.
        state: (4, n) bearing [rad]; velocity along the line of sight and to its right, both by the
            range [1/s]; 1 / range [1/m].
        covariance: (4, 4, n).
    """

    born: int
    number: NDArray[np.int64]
    hits: NDArray[np.int64]
    missed: NDArray[np.int64]
    state: Array
    covariance: Array

    def take(self, which: NDArray[np.bool_]) -> BearingTracks:
        """Some of them."""
        return BearingTracks(
            self.born,
            self.number[which],
            self.hits[which],
            self.missed[which],
            self.state[:, which],
            self.covariance[..., which],
        )


def no_tracks(born: int = 0) -> BearingTracks:
    """None; of so many that there have been."""
    none = np.zeros(0, dtype=np.int64)
    return BearingTracks(born, none, none, none, np.zeros((4, 0)), np.zeros((4, 4, 0)))


def followed(
    tracks: BearingTracks, elapsed_s: float, moved_m: Array, bearing_rad: Array, sigma_rad: Array
) -> tuple[BearingTracks, NDArray[np.int64]]:
    """The tracks after one look, and whose each bearing is.

    Args:
        elapsed_s: since the last look.
        moved_m: (2,) way of the carrier since then, east and north.
        bearing_rad, sigma_rad: (m,).

    Returns:
        Numbers (m,) of the tracks, -1 where that is open.
    """
    tracks = _predicted(tracks, elapsed_s, moved_m)
    off = wrap_pi(bearing_rad - tracks.state[0][:, None])
    variance = tracks.covariance[0, 0][:, None] + sigma_rad**2
    distance2 = off**2 / variance
    track, bearing, is_sure = _pairs(distance2, np.log(variance), tracks.hits >= MATURE)
    name = np.full(len(bearing_rad), -1, dtype=np.int64)
    name[bearing[is_sure]] = tracks.number[track[is_sure]]
    tracks = _with_open(tracks, track[~is_sure])
    track, sure = track[is_sure], bearing[is_sure]
    tracks = _improved(tracks, track, off[track, sure], sigma_rad[sure])
    is_new = np.ones(len(name), dtype=np.bool_)
    is_new[bearing] = False
    name[is_new] = tracks.born + np.arange(is_new.sum())
    tracks = _joined(tracks, bearing_rad[is_new], sigma_rad[is_new])
    return tracks.take(tracks.missed <= PATIENCE), name


def _predicted(tracks: BearingTracks, elapsed_s: float, moved_m: Array) -> BearingTracks:
    """As expected at the next look."""
    state = tracks.state
    columns = []
    for k, step in enumerate(_STEPS):
        nudge = np.zeros((4, 1))
        nudge[k] = step
        ahead, behind = (_carried(state + s * nudge, elapsed_s, moved_m) for s in (1, -1))
        columns.append((ahead - behind) / (2 * step))
    by = np.stack(columns, axis=1)
    covariance = np.einsum("ikn,kln,jln->ijn", by, tracks.covariance, by)
    by_range = state[3] ** 2 + tracks.covariance[3, 3]
    noise = (_SIGMA_ACCELERATION_MPS2 * elapsed_s) ** 2 * by_range
    half_s = elapsed_s / 2
    covariance[0, 0] += noise * half_s**2
    covariance[0, 2] += noise * half_s
    covariance[2, 0] += noise * half_s
    covariance[1, 1] += noise
    covariance[2, 2] += noise
    return tracks._replace(state=_carried(state, elapsed_s, moved_m), covariance=covariance)


def _carried(state: Array, elapsed_s: float, moved_m: Array) -> Array:
    """States (4, n) after a while in which the target held its velocity."""
    bearing, along, across, inverse = state
    sine, cosine = np.sin(bearing), np.cos(bearing)
    forth = 1 + along * elapsed_s - (moved_m[0] * sine + moved_m[1] * cosine) * inverse
    right = across * elapsed_s - (moved_m[0] * cosine - moved_m[1] * sine) * inverse
    by_range = (along - 1j * across) * np.exp(1j * np.arctan2(right, forth))
    longer = np.maximum(np.hypot(forth, right), 1e-3)
    return np.stack(
        [
            bearing + np.arctan2(right, forth),
            by_range.real / longer,
            -by_range.imag / longer,
            inverse / longer,
        ]
    )


def _pairs(
    distance2: Array, log_variance: Array, is_mature: NDArray[np.bool_]
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
    """Tracks and bearings (k,) of the likeliest pairing, and which of the pairs are sure.

    A bearing that several mature tracks might have taken, as likely, is not sure for any of them.
    """
    possible = distance2 <= GATE
    if not possible.any():
        none = np.zeros(0, dtype=np.intp)
        return none, none, np.zeros(0, dtype=np.bool_)
    left_out = GATE + log_variance[possible].max()
    gain = np.where(possible, np.maximum(left_out - distance2 - log_variance, 1e-9), 0.0)
    track, bearing, best = _likeliest(gain)
    kept = possible[track, bearing]
    track, bearing = track[kept], bearing[kept]
    is_sure = np.ones(len(track), dtype=np.bool_)
    rivals = possible[is_mature].sum(axis=0)[bearing] > 1
    for k in np.flatnonzero(rivals & is_mature[track]):
        other = gain.copy()
        other[track[k], bearing[k]] = 0.0
        is_sure[k] = best - _likeliest(other)[2] > 2 * OPEN_NATS
    return track, bearing, is_sure


def _likeliest(gain: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], float]:
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415  (0.4 s, at the first use)

    rows, columns = linear_sum_assignment(gain, maximize=True)
    return rows, columns, float(gain[rows, columns].sum())


def _with_open(tracks: BearingTracks, which: NDArray[np.intp]) -> BearingTracks:
    """With what is counted of those whose bearing is open."""
    missed = tracks.missed.copy()
    missed[which] += OPEN_COUNTS - 1
    return tracks._replace(missed=missed)


def _improved(
    tracks: BearingTracks, which: NDArray[np.intp], off: Array, sigma: Array
) -> BearingTracks:
    """Each of some tracks after its bearing; the others have missed one."""
    state, covariance = tracks.state.copy(), tracks.covariance.copy()
    hits, missed = tracks.hits.copy(), tracks.missed + 1
    row = covariance[:, 0][:, which]
    gain = row / (row[0] + sigma**2)
    state[:, which] += gain * off
    covariance[..., which] -= gain[:, None] * row[None]
    hits[which] += 1
    missed[which] = 0
    return tracks._replace(hits=hits, missed=missed, state=state, covariance=covariance)


def _joined(tracks: BearingTracks, bearing: Array, sigma: Array) -> BearingTracks:
    """With a new track for each of some bearings."""
    count = len(bearing)
    state = np.zeros((4, count))
    state[0], state[3] = bearing, _INVERSE_RANGE
    covariance = np.zeros((4, 4, count))
    by_range = _SIGMA_SPEED_MPS**2 * (_INVERSE_RANGE**2 + _SIGMA_INVERSE_RANGE**2)
    covariance[0, 0], covariance[3, 3] = sigma**2, _SIGMA_INVERSE_RANGE**2
    covariance[1, 1] = covariance[2, 2] = by_range
    return BearingTracks(
        tracks.born + count,
        np.concatenate([tracks.number, tracks.born + np.arange(count)]),
        np.concatenate([tracks.hits, np.ones(count, dtype=np.int64)]),
        np.concatenate([tracks.missed, np.zeros(count, dtype=np.int64)]),
        np.concatenate([tracks.state, state], axis=1),
        np.concatenate([tracks.covariance, covariance], axis=2),
    )
