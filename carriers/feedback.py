"""Corrections that come back to a carrier: which one it applies at a step, and what comes of it.

In lock-step that is the one of `WINDOW` steps before, for which the step waits: the world has
granted it only because the fusion centre is past that one, so the correction has been sent. Else
it is the newest that has come.
"""

from __future__ import annotations

from math import pi, remainder

from msgspec.structs import replace

from schemas import keys
from schemas.bus.ledger import StreamKey
from schemas.bus.recovery import Gap
from schemas.feedback import TURN, WINDOW, Corrected
from schemas.messages import Correction, Feedback, Navigation, Pose

MOST_KEPT = 128
NS = 1e-9


class Corrections:
    """The corrections of one life of a carrier, by the step of the Closed they belong to."""

    def __init__(self, carrier: str) -> None:
        self._stream = keys.CORRECTION.template.format(centre=keys.FUSION, carrier=carrier)
        self._by_step: dict[int, Correction] = {}

    def note(self, correction: Correction) -> None:
        """Take one in; of too many the newest stay."""
        self._by_step.setdefault(correction.step, correction)
        if len(self._by_step) > MOST_KEPT:
            del self._by_step[min(self._by_step)]

    def newest(self) -> Correction | None:
        """What holds now where nobody waits."""
        return self._by_step[max(self._by_step)] if self._by_step else None

    def missing(self, step: int, first_step: int) -> list[Gap]:
        """What a step in lock-step still waits for; older corrections are forgotten.

        Args:
            first_step: of this life; what was found of an earlier one is not waited for.
        """
        needed = step - WINDOW
        self._by_step = {k: kept for k, kept in self._by_step.items() if k >= needed}
        if needed < first_step or needed in self._by_step:
            return []
        return [(StreamKey(keys.FUSION, "", self._stream), needed, needed)]

    def of(self, step: int) -> Correction | None:
        """The one for a step in lock-step."""
        return self._by_step.get(step - WINDOW)

    def clear(self) -> None:
        """A new life begins."""
        self._by_step.clear()


def applied(
    correction: Correction | None,
    navigation: Navigation,
    since_ns: int,
    reckoning_m2_s: float = 0.0,
) -> Corrected | None:
    """A correction put to the pose of a moment; None if there is none to be applied.

    Args:
        navigation: of now, without any correction.
        since_ns: since when the carrier errs as it does now: the start of its life, or a fix. What
            was found of before holds no longer.
        reckoning_m2_s: variance per axis that the noise of its readings gives its way in a second.
    """
    if correction is None or correction.state != "applied" or correction.feedback is None:
        return None
    if correction.valid_t_ns < since_ns:
        return None
    passed_s = (navigation.t_ns - correction.valid_t_ns) * NS
    pose = _moved(navigation.pose, correction.feedback, passed_s)
    if abs(pose.latitude_rad) > pi / 2:
        return None
    grown = 1.0 + (passed_s / correction.valid_for_s) ** 2 if correction.valid_for_s else 1.0
    astray_m2 = reckoning_m2_s * abs(passed_s)
    covariance = _spread(correction.feedback.covariance, grown, astray_m2)
    pose = replace(pose, covariance=covariance)
    return Corrected(correction.id, pose, correction.feedback.north_rad)


def _moved(pose: Pose, feedback: Feedback, passed_s: float) -> Pose:
    """A pose with what a correction adds to it, so long after it was found."""
    latitude = feedback.latitude_rad + passed_s * feedback.latitude_rad_s
    longitude = feedback.longitude_rad + passed_s * feedback.longitude_rad_s
    return replace(
        pose,
        latitude_rad=pose.latitude_rad + latitude,
        longitude_rad=remainder(pose.longitude_rad + longitude, TURN),
        heading_rad=remainder(pose.heading_rad + feedback.north_rad, TURN),
    )


def _spread(covariance: list[float], grown: float, astray_m2: float) -> list[float]:
    """The covariance of (east, north, own north) with that of the place grown, and added to."""
    ee, en, ea, nn, na, aa = covariance
    root = grown**0.5
    return [ee * grown + astray_m2, en * grown, ea * root, nn * grown + astray_m2, na * root, aa]
