"""The figures of a recording: what the page, the Markdown and the JSON say in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

import numpy as np
from msgspec import Struct
from scipy.special import chdtri

from crossfix.commands.info import ending
from crossfix.evaluation import (
    AlignmentError,
    AlignmentSummary,
    BeaconSummary,
    FrameSummary,
    PictureSummary,
    alignment_errors,
    said_errors,
    summarise,
    summarise_alignment,
    summarise_beacons,
    summarise_picture,
)
from schemas.messages import Navigation, TruthCarriers
from schemas.recording.fingerprint import Fingerprint

from .accounts import (
    LossFigures,
    News,
    TimingFigures,
    loss_figures,
    news,
    timing_figures,
)
from .series import FrameSeries
from .sources import SourceFigures, source_figures
from .story import Story

DIMENSIONS = 3
"""Of a correction: east, north, orientation."""
CONFIDENCE = 0.95


class TruthFigures(Struct, frozen=True, kw_only=True):
    """A carrier's frame against the truth, root mean squares over the second half of the run.

    Attributes:
        corrections: how many that half has.
        before_m, after_m: error of the place in own axes; fixed_*: in axes fixed to true north.
        sigma_m, sigma_rad: claimed.
        nees_per_dimension: 1 where sigma is honest.
        nees_inside: share of single values inside their 95 % interval.
    """

    corrections: int
    before_m: float
    after_m: float
    before_rad: float
    after_rad: float
    fixed_before_m: float
    fixed_after_m: float
    sigma_m: float
    sigma_rad: float
    nees_per_dimension: float
    nees_inside: float


class CarrierFigures(Struct, frozen=True, kw_only=True):
    """The correction of one carrier.

    Attributes:
        state, reason: at the end.
        applied_after_s: when it was first applied; None if never.
        state_s: how long it was in each state.
        moved_m, turned_rad: the last correction; None where there is none. sigma_*: its own.
        pairs: target logs it rests on, mean over the second half.
        applies: the carrier applies its corrections.
        said_m: error of the place in own axes that it reports then, over the second half; None
            where no truth is recorded.
        truth: None where no truth is recorded.
    """

    name: str
    state: str
    reason: str
    applied_after_s: float | None
    state_s: dict[str, float]
    moved_m: float | None
    turned_rad: float | None
    sigma_m: float | None
    sigma_rad: float | None
    pairs: float | None
    applies: bool = False
    said_m: float | None = None
    truth: TruthFigures | None


class PictureFigures(Struct, frozen=True, kw_only=True):
    """The tracks of the picture.

    Attributes:
        tracks: that are shown at the end.
        objects: number of them expected then, shown or not, and its sigma.
        truth: None where no truth is recorded.
    """

    tracks: int
    objects: float
    sigma_objects: float
    truth: PictureSummary | None


class Figures(Struct, frozen=True, kw_only=True):
    """All of them.

    Attributes:
        notices: what a reader should know before reading the rest.
        sampling: what of it is drawn only in part.
        picture: None where the recording holds none.
        alignment, beacons: what beacons and ranges tell; empty where there are none.
        sources: that said something.
    """

    recording: str
    bytes: int
    messages: int
    run: str
    scenario: str
    title: str
    own: str
    ending: str
    has_truth: bool
    notices: list[str]
    sampling: list[str]
    duration_s: float
    steps: int
    steps_declared: int
    carriers: list[CarrierFigures]
    picture: PictureFigures | None
    alignment: list[AlignmentSummary]
    beacons: list[BeaconSummary]
    sources: list[SourceFigures]
    losses: LossFigures
    news: list[News]
    timing: TimingFigures
    recorded_ns: int
    versions: dict[str, str]
    fingerprint: Fingerprint
    config_hash: str


def figures_of(story: Story, series: Sequence[FrameSeries]) -> Figures:
    """The figures of a story and of its corrections."""
    header = story.summary.header
    return Figures(
        recording=story.summary.path,
        bytes=story.summary.bytes,
        messages=story.summary.messages,
        run=header.run,
        scenario=story.scenario.name,
        title=story.scenario.title or story.scenario.name,
        own=story.own,
        ending=ending(story.summary),
        has_truth=story.has_truth,
        notices=notices(story, series),
        sampling=sampling(story),
        duration_s=story.time_s(story.end_ns),
        steps=story.closings[-1].step if story.closings else 0,
        steps_declared=story.scenario.steps,
        carriers=_carriers(story, series),
        picture=picture_figures(story),
        alignment=_alignment(story),
        beacons=_beacons(story),
        sources=source_figures(story),
        losses=loss_figures(story),
        news=news(story),
        timing=timing_figures(story),
        recorded_ns=header.created_ns,
        versions=header.versions,
        fingerprint=header.fingerprint,
        config_hash=header.config_hash,
    )


def picture_figures(story: Story) -> PictureFigures | None:
    """The picture's."""
    last = story.last_picture
    if last is None:
        return None
    return PictureFigures(
        tracks=len(last.tracks),
        objects=last.objects,
        sigma_objects=last.sigma_objects,
        truth=summarise_picture(story.picture_errors),
    )


def _alignment(story: Story) -> list[AlignmentSummary]:
    told = story.alignments[-1].carriers if story.alignments else []
    errors = alignment_of(story)
    return [summarise_alignment(errors.get(c.carrier, []), c) for c in told]


def alignment_of(story: Story) -> dict[str, list[AlignmentError]]:
    """Errors of all alignments, by carrier."""
    said = [message for messages in story.navigation.values() for message in messages]
    return alignment_errors(
        story.scenario, story.own, [*story.truth_carriers, *said, *story.alignments]
    )


def _beacons(story: Story) -> list[BeaconSummary]:
    if not story.alignments:
        return []
    return summarise_beacons(story.scenario, story.alignments[-1], story.true_beacons_m)


def nees_interval() -> tuple[float, float]:
    """Where 95 % of single NEES values per dimension lie when sigma is honest."""
    rest = (1 - CONFIDENCE) / 2
    low, high = (float(chdtri(DIMENSIONS, above)) for above in (1 - rest, rest))
    return low / DIMENSIONS, high / DIMENSIONS


def _carriers(story: Story, series: Sequence[FrameSeries]) -> list[CarrierFigures]:
    navigation = [message for said in story.navigation.values() for message in said]
    told: list[TruthCarriers | Navigation] = [*story.truth_carriers, *navigation]
    told.sort(key=lambda message: message.t_ns)
    said: dict[str, Sequence[float]] = {m.carrier: () for m in navigation if m.correction_id}
    said |= said_errors(story.scenario, story.own, told)
    return [carrier_figures(s, said.get(s.carrier)) for s in series]


def rms(values: Sequence[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def carrier_figures(series: FrameSeries, said_m: Sequence[float] | None = None) -> CarrierFigures:
    """One carrier's.

    Args:
        said_m: errors of the places it reports while it applies its corrections; None: it does not.
    """
    state_s: dict[str, float] = {}
    for span in series.states:
        state_s[span.name] = state_s.get(span.name, 0.0) + span.to_s - span.from_s
    applied = [span.from_s for span in series.states if span.name == "applied"]
    has_estimate = np.isfinite(series.estimate[:, 0])
    last = np.flatnonzero(has_estimate)[-1] if has_estimate.any() else None
    moved = None if last is None else series.estimate[last].tolist()
    sigma = None if last is None else series.sigma[last].tolist()
    pairs = series.pairs[has_estimate]
    return CarrierFigures(
        name=series.carrier,
        state=series.last.state,
        reason=series.last.reason,
        applied_after_s=applied[0] if applied else None,
        state_s=state_s,
        moved_m=moved and hypot(*moved[:2]),
        turned_rad=moved and moved[2],
        sigma_m=sigma and hypot(*sigma[:2]),
        sigma_rad=sigma and sigma[2],
        pairs=float(pairs[len(pairs) // 2 :].mean()) if len(pairs) else None,
        applies=said_m is not None,
        said_m=rms(said_m[len(said_m) // 2 :]) if said_m else None,
        truth=_truth_figures(series) if series.errors else None,
    )


def _truth_figures(series: FrameSeries) -> TruthFigures:
    summary: FrameSummary = summarise(series.carrier, series.errors, series.last)
    late = series.errors[len(series.errors) // 2 :]
    low, high = nees_interval()
    inside = [low <= error.nees / DIMENSIONS <= high for error in late]
    return TruthFigures(
        corrections=summary.corrections,
        before_m=summary.before_m,
        after_m=summary.after_m,
        before_rad=summary.before_rad,
        after_rad=summary.after_rad,
        fixed_before_m=summary.fixed_before_m,
        fixed_after_m=summary.fixed_after_m,
        sigma_m=summary.sigma_m,
        sigma_rad=summary.sigma_rad,
        nees_per_dimension=summary.nees / DIMENSIONS,
        nees_inside=float(np.mean(inside)),
    )


def notices(story: Story, series: Sequence[FrameSeries]) -> list[str]:
    """What a reader should know before reading the rest, as sentences."""
    summary, found = story.summary, []
    if summary.end is None:
        found.append(f"The recording has no end: {summary.condition or 'nobody says why'}.")
    elif summary.condition:
        found.append(f"The file is not whole: {summary.condition}.")
    if story.damage:
        found.append(f"Reading ended early: {story.damage}. What lies before it is shown.")
    if not story.has_truth:
        found.append("No truth is recorded: errors and NEES cannot be shown, only what is claimed.")
    if story.others and not any(np.isfinite(s.estimate).any() for s in series):
        found.append("No correction was found in this recording.")
    if not story.closings:
        found.append("No instant was closed: nothing has been fused.")
    if story.unreadable:
        found.append(f"{story.unreadable} recorded messages are not valid and were passed over.")
    return found


def sampling(story: Story) -> list[str]:
    """What of the tactical picture is drawn only in part, as sentences."""
    found = []
    if (every := max((r.every for r in story.reports.values()), default=1)) > 1:
        found.append(f"One report in {every} of the busiest source is drawn.")
    if (every := story.truth_targets.every) > 1:
        found.append(f"True targets are drawn at one step in {every}.")
    return found
