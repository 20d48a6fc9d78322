"""What leaves the picture at a closing: the confirmed tracks, and how many objects there are."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import NamedTuple

from estimation.object_count import Count
from estimation.tracking import tracker
from schemas.messages import Track

from ..navigation import NS, upper_triangle
from ..state import Notes, State
from .classes import classes_of
from .ways import settings_of

MOST_SPEED_MPS = 1e5
_COVARIANCE = upper_triangle(4)


class Shown(NamedTuple):
    """What is published.

    Attributes:
        objects: how many there are where a sensor ever looked, shown or not.
        tracks: the confirmed ones, surest identity first.
    """

    objects: Count
    tracks: list[Track]


def at_closing(state: State, t_ns: int) -> Shown:
    """The picture at an instant."""
    before = state.picture.picture
    if before is None:
        return Shown(Count(0.0, 0.0), [])
    settings = settings_of(state)
    later = tracker.predicted(before, max(t_ns, before.t_ns), settings)
    back_s = min(0.0, (t_ns - before.t_ns) * NS)
    return Shown(tracker.number(later), _tracks(state, tracker.shown(later, settings), back_s))


def _tracks(state: State, found: tracker.Shown, back_s: float) -> list[Track]:
    """Tracks at the instant of the picture, or so many seconds before it (back_s <= 0)."""
    place = found.mean[:, :2] + back_s * found.mean[:, 2:]
    rows = zip(
        found.identity.tolist(),
        place.tolist(),
        found.mean[:, 2:].tolist(),
        found.covariance[:, *_COVARIANCE].tolist(),
        found.existence.tolist(),
        found.classes.tolist(),
        strict=True,
    )
    names, notes = classes_of(state.scenario), state.picture.notes
    return [
        _track(f"t{number}", notes.get(str(number), Notes()), names, *row)
        for number, *row in rows
        if all(map(isfinite, row[0] + row[1] + row[2])) and max(map(abs, row[1])) < MOST_SPEED_MPS
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
