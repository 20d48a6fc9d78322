"""The tracks of a picture: what each pair with a plot would make of them, and what all pairs do.

A track is a Bernoulli component: it exists with a probability and, if it does, has a state under
each model and a class.

Source: Williams, Marginal multi-Bernoulli filters: RFS derivation of MHT, JIPDA, and
association-based MeMBer, IEEE Trans. AES 51(3), 2015, section IV-A; the models within a track by
Bar-Shalom & Li, Multitarget-Multisensor Tracking: Principles and Techniques, section 4.5 (IMMPDA).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices
from estimation.tracking import aside, features, imm
from estimation.tracking.features import Features, Layout, Said
from estimation.tracking.imm import Bank
from estimation.tracking.marginals import Candidates, Marginals
from estimation.tracking.pairing import Paired, Sums, folded, paired
from estimation.tracking.scan import Scan
from estimation.tracking.tearing import leading, torn

PairTerm = Callable[[Indices, Indices], Array]
_SUREST = 1e12  # times likelier than not: more is not believed of any pair
_MOVES = 1e-4  # probability below which a pair moves no state


class Tracks(NamedTuple):
    """The n Bernoulli components, oldest first.

    Attributes:
        identity: (n,) never used twice.
        existence: (n,) probability.
        bank: states.
        classes: (classes, n) probabilities, given that it exists.
        features: what else is known of it.
        aside: (6, n) what readings that hardly move it say, see `aside`.
    """

    identity: Indices
    existence: Array
    bank: Bank
    classes: Array
    features: Features
    aside: Array

    def take(self, which: Indices) -> Tracks:
        """The tracks `which`, in that order."""
        classes = np.take(self.classes, which, axis=-1)
        bank, known = self.bank.take(which), self.features.take(which)
        said = np.take(self.aside, which, axis=-1)
        return Tracks(self.identity[which], self.existence[which], bank, classes, known, said)


class Pairs(NamedTuple):
    """k gated pairs and what each would do to its track.

    Attributes:
        ends: the pairs, and what is between their tracks and plots.
        likelihood: (k,) density of the plot, features included, given the track.
        model: (models, k) after the plot.
        classes: (classes, k) classes after the plot.
    """

    ends: Paired
    likelihood: Array
    model: Array
    classes: Array

    def take(self, which: Indices) -> Pairs:
        """The pairs `which`, in that order."""
        model, classes = self.model[:, which], self.classes[:, which]
        return Pairs(self.ends.take(which), self.likelihood[which], model, classes)

    @property
    def track(self) -> Indices:
        """(k,), ascending."""
        return self.ends.track

    @property
    def plot(self) -> Indices:
        """(k,)."""
        return self.ends.plot


def none(classes: int, layout: Layout, models: int = 2) -> Tracks:
    """No tracks."""
    nobody, known = np.empty(0, dtype=np.intp), features.unknown(layout, 0)
    bank, said = imm.empty(models), aside.unheard(0)
    return Tracks(nobody, np.empty(0), bank, np.empty((classes, 0)), known, said)


def joined(*parts: Tracks) -> Tracks:
    """The tracks of all, in order."""
    return Tracks(
        np.concatenate([part.identity for part in parts]),
        np.concatenate([part.existence for part in parts]),
        imm.joined(*(part.bank for part in parts)),
        np.concatenate([part.classes for part in parts], axis=-1),
        features.joined(*(part.features for part in parts)),
        np.concatenate([part.aside for part in parts], axis=-1),
    )


def gated(tracks: Tracks, scan: Scan, gate: float, term: PairTerm | None = None) -> Pairs:
    """Pairs whose plot lies within the ellipse of `gate` of either model of the track.

    Args:
        tracks: predicted to the scan.
        scan: one report.
        gate: Mahalanobis distance squared.
        term: logarithm of one more likelihood ratio, of pairs (rows of tracks, plots).
    """
    ends = paired(tracks.bank, scan, gate)
    track, plot = ends.track, ends.plot
    by_model = np.take(tracks.bank.model, track, axis=-1) * np.exp(ends.innovations.log_density)
    likelihood = by_model.sum(axis=0)
    after = by_model / np.maximum(likelihood, 1e-300)
    if term is not None:
        likelihood = likelihood * np.exp(term(track, plot))
    if scan.features is not None:
        likelihood *= features.ratio(tracks.features, scan.features, track, plot)
    classes, told = judged(np.take(tracks.classes, track, axis=-1), scan.evidence, plot)
    return Pairs(ends, likelihood * told, after, classes)


def judged(classes: Array, evidence: Array | None, plot: Indices) -> tuple[Array, Array]:
    """Classes (classes, k) after a plot each, and the likelihood (k,) of its features."""
    if evidence is None:
        return classes, np.ones(classes.shape[-1])
    joint = classes * evidence[:, plot]
    total = joint.sum(axis=0)
    return joint / np.maximum(total, 1e-300), total


def candidates(tracks: Tracks, pairs: Pairs, detection: Array, alone: Array) -> Candidates:
    """Pairs weighed against both ends staying alone.

    Args:
        tracks: n of them.
        pairs: of tracks and plots.
        detection: (n,) probability that each, if it exists, gives a plot.
        alone: (m,) density of each plot if it is of none of the tracks.
    """
    hit = tracks.existence * detection
    odds = hit / (1.0 - hit)
    weight = odds[pairs.track] * pairs.likelihood / np.maximum(alone, 1e-300)[pairs.plot]
    weight = np.minimum(weight, _SUREST)
    return Candidates(pairs.track, pairs.plot, weight, len(hit), len(alone))


def updated(
    tracks: Tracks,
    pairs: Pairs,
    marginals: Marginals,
    detection: Array,
    said: Said | None = None,
) -> tuple[Tracks, Tracks]:
    """Each track after the scan, its hypotheses folded into one by their moments, or torn.

    Args:
        detection: (n,) probability that each, if it exists, gives a plot.
        said: what the plots say of features.

    Returns:
        The tracks, and what is left of those that are torn; these are yet to be named.
    """
    missed = tracks.existence * (1.0 - detection) / (1.0 - tracks.existence * detection)
    missed = missed * marginals.track_alone
    sums = Sums(pairs.track, len(missed))
    existence = missed + sums.of(marginals.pair)
    share = marginals.pair / np.maximum(existence, 1e-300)[pairs.track]
    stay = missed / np.maximum(existence, 1e-300)
    bank = _folded(tracks.bank, pairs, share)
    classes = tracks.classes * stay + sums.of(pairs.classes * share)
    known = tracks.features if said is None else _told(tracks, pairs, share, said)
    surely = np.minimum(existence, 1.0)
    folds = Tracks(tracks.identity, surely, bank, classes, known, tracks.aside)
    return _torn(tracks, folds, pairs, share, said)


def _torn(
    tracks: Tracks, folds: Tracks, pairs: Pairs, share: Array, said: Said | None
) -> tuple[Tracks, Tracks]:
    """The tracks, those that are torn as their leading pair has them; and what is left of those."""
    lead = leading(pairs.track, share, folds.existence)
    some = pairs.take(lead)
    apart = torn(tracks.bank, folds.bank, some.ends, share[lead], some.model)
    some, part = some.take(apart.pair), share[lead[apart.pair]]
    row, whole = some.track, folds.take(some.track)
    left = np.maximum(whole.classes - some.classes * part, 0.0)
    rest = whole._replace(
        existence=whole.existence * (1.0 - part),
        bank=apart.rest,
        classes=left / left.sum(axis=0),
        aside=aside.unheard(len(row)),
    )
    known = whole.features
    if said is not None:
        known = features.after(tracks.features, said, row, some.plot)
    torn_off = whole._replace(
        existence=whole.existence * part, bank=apart.lead, classes=some.classes, features=known
    )
    return _with(folds, row, torn_off), rest


def _with(folds: Tracks, row: Indices, others: Tracks) -> Tracks:
    """The folds with others in some rows. Written into what is ours; features may not be."""
    mine = (folds.existence, *folds.bank, folds.classes)
    theirs = (others.existence, *others.bank, others.classes)
    for part, into in zip(mine, theirs, strict=True):
        part[..., row] = into
    known = Features(*(part.copy() for part in folds.features))
    for part, into in zip(known, others.features, strict=True):
        part[..., row] = into
    return folds._replace(features=known)


def _told(tracks: Tracks, pairs: Pairs, share: Array, said: Said) -> Features:
    """Features over the hypotheses of each track; pairs of negligible share count as a miss."""
    some = np.flatnonzero(share > _MOVES)
    track, plot = pairs.track[some], pairs.plot[some]
    told = features.after(tracks.features, said, track, plot)
    sums = Sums(track, len(tracks.identity))
    return features.folded(tracks.features, told, track, share[some], sums.of)


def _folded(bank: Bank, pairs: Pairs, share: Array) -> Bank:
    """First two moments of each model over the hypotheses: a miss and the pairs.

    Pairs of negligible share count as a miss.
    """
    some = np.flatnonzero(share > _MOVES)
    sums = Sums(pairs.track[some], bank.model.shape[-1])
    joint = pairs.model[:, some] * share[some]
    stay = 1.0 - sums.of(share[some])
    model = bank.model * stay + sums.of(joint)
    given = joint / np.maximum(model, 1e-300)[:, pairs.track[some]]
    return folded(bank, pairs.ends.take(some), given)._replace(model=model / model.sum(axis=0))
