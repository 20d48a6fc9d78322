"""What leaves the picture at a closing: the confirmed tracks, and how many objects there are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimation.object_count import Count
from estimation.tracking import tracker
from schemas.messages import Track

from ..navigation import NS, upper_triangle
from ..state import Notes, State
from .classes import classes_of
from .ways import settings_of

MOST_SPEED_MPS = 1e5
_COVARIANCE = upper_triangle(4)


def objects(state: State, t_ns: int) -> Count:
    """How many objects there are where a sensor ever looked, shown or not."""
    drawn = state.picture
    if drawn.picture is None:
        return Count(0.0, 0.0)
    later = tracker.predicted(drawn.picture, max(t_ns, drawn.picture.t_ns), settings_of(state))
    return tracker.number(later)


def tracks(state: State, t_ns: int) -> list[Track]:
    """What is shown at an instant: the confirmed tracks, surest identity first."""
    drawn = state.picture
    if drawn.picture is None:
        return []
    settings = settings_of(state)
    later = tracker.predicted(drawn.picture, max(t_ns, drawn.picture.t_ns), settings)
    shown = tracker.shown(later, settings)
    back_s = min(0.0, (t_ns - drawn.picture.t_ns) * NS)
    place = shown.mean[:, :2] + back_s * shown.mean[:, 2:]
    rows = zip(
        shown.identity.tolist(),
        place.tolist(),
        shown.mean[:, 2:].tolist(),
        shown.covariance[:, *_COVARIANCE].tolist(),
        shown.existence.tolist(),
        shown.classes.tolist(),
        strict=True,
    )
    names = classes_of(state.scenario)
    return [
        _track(f"t{number}", drawn.notes.get(str(number), Notes()), names, *row)
        for number, *row in rows
        if np.isfinite(row[0] + row[1] + row[2]).all() and max(map(abs, row[1])) < MOST_SPEED_MPS
    ]


def _track(
    name: str,
    notes: Notes,
    names: Sequence[str],
    place: list[float],
    rate: list[float],
    covariance: list[float],
    existence: float,
    classes: list[float],
) -> Track:
    return Track(
        id=name,
        position_m=place,
        velocity_mps=rate,
        covariance=covariance,
        existence=min(existence, 1.0),
        classes=dict(zip(names, (min(share, 1.0) for share in classes), strict=False)),
        carriers=sorted({source.partition("/")[0] for source in notes.logs}),
        logs=sorted(notes.logs.values()),
    )
