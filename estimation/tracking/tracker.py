"""One picture from the scans of many sources: tracks with existence, state and class.

The posterior is a Poisson intensity of targets not yet detected plus one Bernoulli component for
each track, kept to one component a track after every scan by its association marginals (TOMB/P).

Source: Williams, Marginal multi-Bernoulli filters: RFS derivation of MHT, JIPDA, and
association-based MeMBer, IEEE Trans. AES 51(3), 2015, section IV-A.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices
from estimation.object_count import Count, object_count
from estimation.tracking import aside, bernoulli, frame_errors, imm, undetected
from estimation.tracking.bernoulli import Pairs, PairTerm, Tracks
from estimation.tracking.births import alone
from estimation.tracking.features import Layout
from estimation.tracking.frame_errors import Frames
from estimation.tracking.imm import Motion
from estimation.tracking.marginals import Candidates, Marginals, by_belief
from estimation.tracking.scan import Scan
from estimation.tracking.undetected import Region, Undetected

_SUREST = 0.999  # no sensor sees more surely: a miss must not be impossible
_FAINT = 0.1  # existence below which what is left of a torn track is none
_MISSED = 0.5  # probability from which a track is said to have had no plot
_SURELY = 0.5  # probability from which a plot is taken for a track's, so that it has at most one


class Settings(NamedTuple):
    """What the tracker expects of the world, and where it stops caring.

    Attributes:
        motion: of targets.
        region: of the picture.
        lifetime_s: mean time between a target's appearing and its vanishing.
        gate: Mahalanobis distance squared beyond which a plot is not of a track.
        confirmed: existence from which a track is shown.
        pruned: existence below which it is dropped.
        classes: prior probability of each class.
        features: which there are.
        associate: marginals from candidates; `by_assignment` is the simple mode.
    """

    motion: Motion = Motion()
    region: Region = Region()
    lifetime_s: float = 600.0
    gate: float = 16.0
    confirmed: float = 0.5
    pruned: float = 5e-4
    classes: tuple[float, ...] = (1.0,)
    features: Layout = Layout()
    associate: Callable[[Candidates], Marginals] = by_belief


class Picture(NamedTuple):
    """Everything the tracker knows at `t_ns`; never changed in place.

    Attributes:
        t_ns: of the last scan.
        tracks: all of them, shown or not.
        undetected: targets no track stands for.
        begun: number of tracks ever begun: the identity of the next one.
        frames: whose errors tracks remember.
    """

    t_ns: int
    tracks: Tracks
    undetected: Undetected
    begun: int
    frames: Frames = frame_errors.NONE


class Association(NamedTuple):
    """What a step did with its m plots.

    Attributes:
        identity: (k,) track of each gated pair, plot: (k,), probability: (k,).
        distance: (k,) Mahalanobis distance squared under the likeliest model.
        begun: (m,) identity of the track each plot began, -1 if none.
    """

    identity: Indices
    plot: Indices
    probability: Array
    distance: Array
    begun: Indices


class Shown(NamedTuple):
    """The n tracks of a picture that are shown.

    Attributes:
        identity, existence: (n,).
        mean: (n, 4) east, north [m], their rates [m/s]; covariance: (n, 4, 4).
        manoeuvring: (n,) probability of the model of most noise.
        classes: (n, classes) probabilities.
    """

    identity: Indices
    existence: Array
    mean: Array
    covariance: Array
    manoeuvring: Array
    classes: Array


def nothing(settings: Settings, t_ns: int) -> Picture:
    """The picture before any scan."""
    tracks = bernoulli.none(len(settings.classes), settings.features, settings.motion.models)
    return Picture(t_ns, tracks, undetected.unseen(settings.region), 0)


def step(
    before: Picture, scan: Scan, settings: Settings, term: PairTerm | None = None
) -> tuple[Picture, Association]:
    """The picture after a scan, and which plots were taken for which tracks.

    Args:
        before: left as it is.
        scan: one report of one source, no older than `before`.
        settings: the same in every step.
        term: logarithm of one more likelihood ratio of pairs (rows of `before.tracks`, plots).

    Raises:
        ValueError: the scan is older than the picture.
    """
    now, scan = _with_frames(predicted(before, scan.t_ns, settings), scan)
    pairs = bernoulli.gated(now.tracks, scan, settings.gate, term)
    classes, layout = np.asarray(settings.classes), settings.features
    lone = alone(now.undetected, scan, settings.motion, classes, layout)
    place, spread = imm.places(now.tracks.bank)
    in_view = scan.view.chance(place, spread)
    detection = min(scan.detection, _SUREST) * in_view
    candidates = bernoulli.candidates(now.tracks, pairs, detection, lone.density)
    marginals = settings.associate(candidates)
    old, rest = bernoulli.updated(now.tracks, pairs, marginals, detection, scan.features)
    right = pairs.ends.take(np.flatnonzero(marginals.pair > _SURELY))
    old = old._replace(aside=aside.heard(old.aside, now.tracks.bank, scan, right))
    new, begun = _named(lone.tracks, marginals.plot_alone, now.begun, settings.pruned)
    errors = now.tracks.bank.shared.shape[1]
    new = new._replace(bank=frame_errors.begun(new.bank, scan.common, errors))
    lost = undetected.vague(settings.region, spread) & (marginals.track_alone > _MISSED)
    lost |= aside.elsewhere(old.aside)
    kept = old.take(np.flatnonzero((old.existence >= settings.pruned) & ~lost))
    hidden = undetected.returned(lone.undetected, place[:, lost], old.existence[lost])
    first = now.begun + len(new.identity)
    torn, hidden = _kept(rest, first, hidden)
    after = Picture(
        scan.t_ns,
        bernoulli.joined(kept, new, torn),
        hidden,
        first + len(torn.identity),
        now.frames,
    )
    return after, _association(now.tracks, pairs, marginals, begun)


def predicted(before: Picture, t_ns: int, settings: Settings) -> Picture:
    """The picture at a later instant.

    Raises:
        ValueError: the instant is earlier.
    """
    dt_s = (t_ns - before.t_ns) * 1e-9
    if dt_s < 0:
        raise ValueError(f"a picture cannot go back: it is at {before.t_ns} ns, asked {t_ns} ns")
    tracks = before.tracks
    survives = math.exp(-dt_s / settings.lifetime_s)
    later = tracks._replace(
        existence=tracks.existence * survives,
        bank=imm.predicted(tracks.bank, dt_s, settings.motion),
    )
    targets = float(tracks.existence.sum()) + undetected.expected(before.undetected)
    hidden = undetected.aged(before.undetected, dt_s, settings.lifetime_s, targets)
    return Picture(t_ns, later, hidden, before.begun, before.frames)


def _with_frames(now: Picture, scan: Scan) -> tuple[Picture, Scan]:
    """The picture with the error of the scan's frame among what tracks remember."""
    frames, bank, common = frame_errors.met(now.frames, now.tracks.bank, scan.common)
    known = now._replace(tracks=now.tracks._replace(bank=bank), frames=frames)
    return known, scan._replace(common=common)


def shown(picture: Picture, settings: Settings) -> Shown:
    """The confirmed tracks."""
    tracks = picture.tracks.take(np.flatnonzero(picture.tracks.existence >= settings.confirmed))
    mean, covariance = imm.combined(tracks.bank)
    return Shown(
        tracks.identity,
        tracks.existence,
        mean.T,
        np.moveaxis(covariance, -1, 0),
        tracks.bank.model[-1],
        tracks.classes.T,
    )


def number(picture: Picture) -> Count:
    """How many targets there are, with a track or without, where a sensor ever looked."""
    return object_count(picture.tracks.existence, undetected.expected(picture.undetected))


def _named(lone: Tracks, chance: Array, first: int, pruned: float) -> tuple[Tracks, Indices]:
    """New tracks worth keeping, with identities, and the identity each plot began or -1."""
    begun = np.full(len(chance), -1, dtype=np.intp)
    if not len(lone.identity):
        return lone, begun
    existence = lone.existence * chance
    kept = np.flatnonzero(existence >= pruned)
    begun[kept] = first + np.arange(len(kept))
    new = lone._replace(existence=existence).take(kept)
    return new._replace(identity=begun[kept]), begun


def _kept(rest: Tracks, first: int, hidden: Undetected) -> tuple[Tracks, Undetected]:
    """What is left of torn tracks, named; if it hardly exists it goes back to the undetected."""
    place, _ = imm.places(rest.bank)
    faint = rest.existence < _FAINT
    hidden = undetected.returned(hidden, place[:, faint], rest.existence[faint])
    kept = rest.take(np.flatnonzero(~faint))
    return kept._replace(identity=first + np.arange(len(kept.identity))), hidden


def _association(tracks: Tracks, pairs: Pairs, marginals: Marginals, begun: Indices) -> Association:
    distance = pairs.ends.innovations.distance_squared()
    likeliest = pairs.model.argmax(axis=0)
    likely = np.take_along_axis(distance, likeliest[None], axis=0)[0]
    return Association(tracks.identity[pairs.track], pairs.plot, marginals.pair, likely, begun)
