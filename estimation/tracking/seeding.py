"""A track from elsewhere: a target whose state another estimator has found."""

from __future__ import annotations

import numpy as np

from estimation.arrays import Array
from estimation.tracking import aside, bernoulli, features
from estimation.tracking.bernoulli import Tracks
from estimation.tracking.frame_errors import begun
from estimation.tracking.imm import Bank, bare
from estimation.tracking.tracker import Picture, Settings


def seeded(
    picture: Picture, mean: Array, covariance: Array, existence: float, settings: Settings
) -> Picture:
    """The picture with one track more; its identity is what `picture.begun` was.

    Args:
        mean: (4,) east, north [m] and their rates [m/s] at `picture.t_ns`.
        covariance: (4, 4).
        existence: probability that the target is there.
    """
    classes = np.asarray(settings.classes, dtype=float)[:, None]
    bank = _of_one(mean, covariance, settings.motion.models)
    bank = begun(bank, None, picture.tracks.bank.shared.shape[1])
    known = features.unknown(settings.features, 1)
    name, sure = np.array([picture.begun]), np.array([existence])
    new = Tracks(name, sure, bank, classes, known, aside.unheard(1))
    return picture._replace(tracks=bernoulli.joined(picture.tracks, new), begun=picture.begun + 1)


def restated(picture: Picture, identity: int, mean: Array, covariance: Array) -> Picture:
    """The picture with the state of one of its tracks told anew, by whoever knows it better."""
    row = int(np.flatnonzero(picture.tracks.identity == identity)[0])
    bank = picture.tracks.bank
    told = _of_one(mean, covariance, len(bank.model))
    means, covariances = bank.mean.copy(), bank.covariance.copy()
    means[..., row], covariances[..., row] = told.mean[..., 0], told.covariance[..., 0]
    shared = bank.shared.copy()
    shared[..., row] = 0.0
    restated_bank = bank._replace(mean=means, covariance=covariances, shared=shared)
    said = picture.tracks.aside.copy()
    said[:, row] = 0.0
    return picture._replace(tracks=picture.tracks._replace(bank=restated_bank, aside=said))


def _of_one(mean: Array, covariance: Array, models: int) -> Bank:
    """A bank of one track, the same under all models; which one holds is open."""
    every = np.repeat(mean[:, None, None], models, axis=1)
    spread = np.repeat(covariance[:, :, None, None], models, axis=2)
    return bare(every, spread, np.full((models, 1), 1.0 / models))
