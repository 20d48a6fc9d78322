"""Frames that are known: improved by the plots of a report event, watched, and doubted.

Every so many events a frame is searched for anew, as if nothing were known of it: a frame that a
search which can be trusted contradicts twice in a row is given up, and so is one that the alarm
says has jumped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace as with_fields
from functools import cache
from typing import Literal

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.consistency import nees
from estimation.frames import wrap_pi
from estimation.relative_frame import Drift, OwnAxesFrame, directions, in_fixed_axes
from estimation.relative_frame.joint import JointFrames
from schemas.messages import SourceTerm

from ..quality import MOST_NIS, Tally
from ..sources.sightings import Pair
from ..sources.telling import telling
from ..state import Estimate, Frames, Link, Monitor, State
from ..state.links import frames_without
from . import corrections, frames, monitor, scans, search, strain, surveyed, watching
from .common import Target, common_targets, network_logs, told_by_a_plot
from .corrections import Misclosure
from .moment import Moment
from .scans import Followed, Scan
from .views import View

MOST_DOF = 2000
CONTRADICTION = 25.0
"""Chi2 of 3 dof beyond which a search has found another frame than the one followed."""
LEAST_USUAL = 2.0
"""Pairs at an event, on average, from which half of them can be missed."""
NEEDS_NO_PAIRS = 0.9
"""Share of the prior sigma from which a direction is not known by its pairs, if it is known."""
FORGETTING = 0.1
"""Weight of the newest event in that average."""
MOST_VALID_S = 1e6
NO_PAIRS = Misclosure(0, 0.0, 0)
_RANGE_TERMS: tuple[Literal["range_bias_m", "range_scale"], ...] = "range_bias_m", "range_scale"


def with_scan(state: State, moment: Moment, names: Sequence[str], tally: Tally) -> State:
    """The state after an event at which these carriers, whose frames are followed, took part."""
    try:
        return _scanned(state, moment, names, tally)
    except (np.linalg.LinAlgError, ValueError) as error:
        return _given_up(state, names, f"no frame comes out of these numbers: {error}")


def _scanned(state: State, moment: Moment, names: Sequence[str], tally: Tally) -> State:
    known = state.frames
    if known is None:
        raise ValueError("no frame is followed")
    names = [name for name in known.carriers if name in names]
    views = [moment.own, *(moment.others[name] for name in names)]
    expected = [frames.frame_of(known, name) for name in names]
    gate = state.settings.association.gate
    targets = common_targets(views, expected, state.orders, gate, telling(state))
    logs = network_logs(views, targets)
    rows = np.array([0, *(frames.row(known, name) for name in names)], dtype=np.intp)
    limits = _limits(state.settings.monitor.chi2_false_alarm)
    logs = with_fields(logs, carrier=rows[logs.carrier])
    found = scans.taken_in(frames.joint(known), logs, len(targets), limits)
    if not np.isfinite(found.joint.covariance).all():
        raise ValueError("a covariance is not finite")
    _count(state, views, names, targets, found, tally)
    better = frames.improved(known, found.joint)
    everyone = (state.own, *known.carriers)
    state = strain.watched(replace(state, frames=better), everyone, found.range_scores, tally)
    for name in names:
        scan = found.scans[frames.row(known, name) - 1]
        only_named = all(m.method != "coordinates" for t in targets for m in t[1:])
        state = _judged(state, moment, name, scan, only_named)
    return state


@cache
def _limits(false_alarm: float) -> list[float]:
    """Chi2 by degrees of freedom beyond which a carrier is out of line."""
    from scipy.special import chdtri

    limits: list[float] = chdtri(np.arange(1, MOST_DOF + 1), false_alarm).tolist()
    return [float("inf"), *limits]


def _judged(state: State, moment: Moment, name: str, scan: Scan | None, only_named: bool) -> State:
    """The state after what one carrier's plots had to say."""
    link: Link = replace(state.links[name], events=state.links[name].events + 1)
    if scan is None and link.usual_pairs == 0 and surveyed.contradicted(state, moment, name):
        return _given_up(state, [name], surveyed.WHY_NOT)
    state = state if scan else _no_less_sure_than_navigation(state, moment, name)
    known = state.frames
    assert known is not None  # noqa: S101
    frame = frames.frame_of(known, name)
    estimate = _estimate(state, moment, name, frame, scan.misclosure if scan else NO_PAIRS)
    link = replace(link, estimate=estimate, monitor=_monitored(state, link, estimate, scan))
    if scan is not None:
        link, alarm = _watched(state, link, name, scan)
        if alarm:
            return _given_up(state, [name], "the frame has jumped: its targets lie elsewhere")
    pairs = scan.misclosure.pairs if scan else 0
    if _is_due_for_doubt(state, link, pairs, only_named):
        link = replace(link, doubts=_doubts(state, moment, name, link, frame))
        if link.doubts > 1:
            why = "a search from the start finds another frame than the one followed"
            return _given_up(state, [name], why)
    usual = link.usual_pairs + FORGETTING * (pairs - link.usual_pairs)
    return _with(state, name, replace(link, usual_pairs=usual))


def _no_less_sure_than_navigation(state: State, moment: Moment, name: str) -> State:
    """The state in which a frame that nobody has seen for long is what navigation says of it.

    Only where that is enough (`surveyed`): else what targets have told is to be remembered.
    """
    found, known = surveyed.known_beforehand(moment, name), state.frames
    if found is None or known is None:
        return state
    before, navigated = frames.frame_of(known, name), corrections.frame_of(found)
    if directions(before.covariance, navigated.covariance)[0].ratio <= 1:
        return state
    joint = frames.joint(known).with_frame(frames.row(known, name), navigated)
    return replace(state, frames=frames.improved(known, joint))


def _monitored(state: State, link: Link, estimate: Estimate, scan: Scan | None) -> Monitor:
    """How far the correction has come; an event without a pair changes nothing but doubt.

    A frame that needs no pairs (`surveyed`) is as good at every event.
    """
    known = estimate.directions[0]
    if scan is None and known.status == "determined" and known.ratio < NEEDS_NO_PAIRS:
        return link.monitor
    judged, _ = monitor.after_registration(link.monitor, estimate, state.settings.monitor)
    return judged


def _watched(state: State, link: Link, name: str, scan: Scan) -> tuple[Link, bool]:
    """The alarm after one more scan."""
    known = state.frames
    assert known is not None  # noqa: S101
    row, joint = frames.row(known, name), frames.joint(known)
    drifted, _ = joint.drift_mps(row)
    stand = watching.Stand(known.t_ns, known.way_m[[0, row]], drifted)

    def normal(seconds: float) -> Drift:
        return scans.drift(joint, row, state.settings.registration, seconds)

    watch, alarm = watching.after_scan(link.watch, scan.expected, scan.said, stand, normal)
    return replace(link, watch=watch), alarm


def _is_due_for_doubt(state: State, link: Link, pairs: int, only_named: bool) -> bool:
    """Whether a frame is to be searched for anew: a doubt is open, pairs are lost, or it is time.

    What rests on names alone is not doubted on time.
    """
    on_time = link.events % state.settings.registration.verify_every == 0 and not only_named
    lost = link.usual_pairs >= LEAST_USUAL and pairs < link.usual_pairs / 2
    return on_time or lost or link.doubts > 0


def _doubts(state: State, moment: Moment, name: str, link: Link, frame: OwnAxesFrame) -> int:
    """How many searches in a row have found another frame."""
    prior, other = moment.prior[name], moment.others[name]
    settings, tells = state.settings.registration, telling(state)
    found = search.searched(moment.own, other, prior, state.orders, settings, tells)
    if found.frame is None:
        return 0
    apart = np.append(found.frame.q_m - frame.q_m, wrap_pi(found.frame.D_rad - frame.D_rad))
    distance = float(nees(apart, found.frame.covariance + frame.covariance))
    return link.doubts + 1 if distance > CONTRADICTION else 0


def _estimate(
    state: State, moment: Moment, name: str, frame: OwnAxesFrame, misclosure: Misclosure
) -> Estimate:
    """A frame as it is published."""
    prior = moment.prior[name]
    plot = told_by_a_plot(moment.others[name])
    estimate = corrections.estimated(
        frame, in_fixed_axes(frame, prior), prior, moment.between[name], misclosure, "joint", plot
    )
    known, link = state.frames, state.links[name]
    assert known is not None  # noqa: S101
    joint, row = frames.joint(known), frames.row(known, name)
    drift_mps, covariance = joint.drift_mps(row)
    unsure_mps, unsure_m = np.sqrt([np.trace(covariance), np.trace(frame.covariance[:2, :2])])
    axes = replace(
        estimate.own_axes,
        drift_east_mps=float(drift_mps[0]),
        drift_north_mps=float(drift_mps[1]),
    )
    return corrections.within_bounds(
        replace(
            estimate,
            own_axes=axes,
            mode_probability=link.mode_probability,
            since_t_ns=link.found_t_ns,
            valid_for_s=min(float(unsure_m / unsure_mps), MOST_VALID_S) if unsure_mps else 0.0,
            terms=_terms(state, name, joint, row),
        )
    )


def _terms(state: State, name: str, joint: JointFrames, row: int) -> tuple[SourceTerm, ...]:
    """The errors of a carrier's ranges, where some were expected and one source measures them."""
    source, ranges = frames.ranging_source(state, name), joint.ranges(row)
    sigmas = np.sqrt(np.maximum(np.diag(ranges.covariance), 0.0)).tolist()
    told = zip(_RANGE_TERMS, ranges.mean.tolist(), sigmas, strict=True)
    return tuple(
        SourceTerm(source=source, name=term, value=-added, sigma=sigma)
        for term, added, sigma in told
        if source and sigma > 0
    )


def _given_up(state: State, names: Sequence[str], reason: str) -> State:
    """The state without the frames of these carriers, which must be found anew."""
    for name in names:
        link = state.links[name]
        was_applied = link.monitor.state in ("applied", "suspended")
        judged = monitor.jumped(reason[: monitor.MAX_REASON])
        judged = judged if was_applied else replace(judged, state="observing")
        kept: Frames | None = frames_without(state.frames, name)
        fresh = Link(monitor=judged, estimate=link.estimate, events=link.events)
        state = _with(replace(state, frames=kept), name, fresh)
    return state


def _count(
    state: State,
    views: Sequence[View],
    names: Sequence[str],
    targets: Sequence[Target],
    found: Followed,
    tally: Tally,
) -> None:
    """Tell who was paired with whom; of a target that three see, with the leading one each."""
    carriers = [state.own, *names]
    told: dict[tuple[int, int], tuple[list[Pair], list[float]]] = {
        (0, k): ([], []) for k in range(1, len(carriers))
    }
    chi2 = np.nan_to_num(2 * found.target_chi2, nan=0.0).clip(0.0, MOST_NIS)
    for target, squared in zip(targets, chi2.tolist(), strict=True):
        lead = target[0]
        for member in target[1:]:
            pairs, nis = told.setdefault((lead.carrier, member.carrier), ([], []))
            pairs.append(Pair(lead.row, member.row, *member[2:]))
            nis.append(squared)
    for (one, other), (pairs, nis) in told.items():
        scores: Array = np.array(nis)
        tally.registered((carriers[one], carriers[other]), views[one], views[other], pairs, scores)


def _with(state: State, name: str, link: Link) -> State:
    return replace(state, links={**state.links, name: link})
