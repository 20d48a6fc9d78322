"""The same of a whole recording: its frames, its picture and its alignment, each summed up."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple, cast

from schemas import keys
from schemas.messages import (
    Alignment,
    Correction,
    DeclaredScenario,
    Navigation,
    TruthCarriers,
)
from schemas.recording.contents import truth_of
from schemas.recording.reader import open_recording

from .alignment import (
    AlignmentSummary,
    BeaconSummary,
    Told,
    alignment_errors,
    summarise_alignment,
    summarise_beacons,
    true_beacons_m,
)
from .frames import FrameSummary, frame_errors, said_errors, summarise
from .pictures import Known, PictureSummary, picture_errors, summarise_picture


class WholeAlignment(NamedTuple):
    """Of carriers and beacons; empty where a run has neither beacons nor ranges, or no truth."""

    carriers: list[AlignmentSummary]
    beacons: list[BeaconSummary]


def frame_summaries(path: Path) -> list[FrameSummary]:
    """Errors of every carrier's frame; empty where the recording holds no truth."""
    with open_recording(path) as recording:
        scenario = recording.scenario
        wanted = (keys.TRUTH_CARRIERS, keys.CORRECTION, keys.NAVIGATION)
        messages = [message.decode() for message in recording.messages(topics=wanted)]
    own, corrections = own_carrier(scenario), [m for m in messages if isinstance(m, Correction)]
    errors = frame_errors(
        scenario, own, [m for m in messages if isinstance(m, TruthCarriers | Correction)]
    )
    told = [m for m in messages if isinstance(m, TruthCarriers | Navigation)]
    said = said_errors(scenario, own, sorted(told, key=_time))
    last = {correction.carrier: correction for correction in corrections}
    return [
        summarise(name, errors.get(name, []), last[name], said.get(name, ()))
        for name in sorted(last)
    ]


def picture_summary(path: Path) -> PictureSummary | None:
    """The picture against the truth; None where the recording lacks either."""
    wanted = (keys.TRUTH_TARGETS, keys.TRUTH_CARRIERS, keys.NAVIGATION, keys.TRACK)
    with open_recording(path) as recording:
        scenario = recording.scenario
        known = (message.decode() for message in recording.messages(topics=wanted))
        messages = cast("Iterable[Known]", known)
        return summarise_picture(picture_errors(scenario, own_carrier(scenario), messages))


def alignment_summary(path: Path) -> WholeAlignment:
    """What beacons and ranges have told, against the truth."""
    wanted = (keys.ALIGNMENT, keys.TRUTH_CARRIERS, keys.NAVIGATION)
    with open_recording(path) as recording:
        scenario = recording.scenario
        if not any(True for _ in recording.messages(topics=(keys.ALIGNMENT,))):
            return WholeAlignment([], [])
        messages = [message.decode() for message in recording.messages(topics=wanted)]
        true_m = true_beacons_m(truth_of(recording.attachments))
    last = [message for message in messages if isinstance(message, Alignment)][-1]
    errors = alignment_errors(scenario, own_carrier(scenario), cast("list[Told]", messages))
    return WholeAlignment(
        [summarise_alignment(errors.get(c.carrier, []), c) for c in last.carriers],
        summarise_beacons(scenario, last, true_m),
    )


def own_carrier(scenario: DeclaredScenario) -> str:
    """The carrier whose axes the picture is in."""
    return str(scenario.fusion.get("own") or scenario.carriers[0].name)


def _time(message: TruthCarriers | Navigation) -> int:
    return message.t_ns
