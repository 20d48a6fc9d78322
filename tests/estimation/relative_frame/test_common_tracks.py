"""Frames found from the same own tracks: no surer together than these, however many they are."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.frames import rotation_clockwise
from estimation.relative_frame import OwnAxesFrame
from estimation.relative_frame.common_tracks import Tracks, shared
from estimation.relative_frame.joint import WIDTH, JointFrames, own_alone
from estimation.relative_frame.range_errors import gains

TARGETS_M = np.array([[4e3, 1e3], [-3e3, 5e3], [-1e3, -6e3], [6e3, -4e3], [500.0, 7e3]])
PLACES_M = np.array([[0.0, 0.0], [5e3, 2e3], [-4e3, 3e3], [1e3, -5e3], [7e3, 6e3], [-6e3, -2e3]])
TURNS_RAD = np.array([0.0, 0.3, -0.2, 1.0, -2.0, 0.05])
SPREAD = np.diag([900.0, 400.0])


def seen_by(carrier: int) -> Array:
    """Targets from a carrier along its own axes."""
    return (TARGETS_M - PLACES_M[carrier]) @ rotation_clockwise(TURNS_RAD[carrier])


def found(carrier: int) -> tuple[OwnAxesFrame, Array]:
    """The frame of a carrier by its tracks and the own ones, and its gain on each of the latter."""
    away, turn = TARGETS_M - PLACES_M[carrier], TURNS_RAD[carrier]
    by = np.zeros((len(away), 2, 3))
    by[:, 0, 0] = by[:, 1, 1] = 1.0
    by[:, 0, 2], by[:, 1, 2] = away[:, 1], -away[:, 0]
    rotation = rotation_clockwise(turn)
    spread = SPREAD + rotation @ SPREAD @ rotation.T
    information = np.einsum("nai,ab,nbj->ij", by, np.linalg.inv(spread), by)
    frame = OwnAxesFrame(PLACES_M[carrier], np.array(turn), np.linalg.inv(information))
    every = np.broadcast_to(SPREAD, (len(away), 2, 2))
    return frame, gains(frame, every, seen_by(carrier), every)


def joined(carriers: int) -> JointFrames:
    """All carriers found one after another, at one instant."""
    joint = own_alone(0.0, 0.0)
    for new in range(1, carriers):
        frame, gain = found(new)
        count = len(TARGETS_M)
        tracks = Tracks(
            carrier=np.repeat(np.arange(new), count),
            target=np.tile(np.arange(count), new),
            places_m=np.vstack([seen_by(carrier) for carrier in range(new)]),
            covariance=np.broadcast_to(SPREAD, (new * count, 2, 2)),
        )
        common = shared(joint, tracks, 0, frame, gain)
        joint = joint.joined_by(frame, 0.0, 0.0, shared=common)
    return joint


def rows(carrier: int) -> slice:
    return slice(WIDTH * carrier, WIDTH * carrier + 3)


def test_the_second_frame_hangs_on_the_first_by_the_own_tracks_of_both() -> None:
    (_, first), (_, second) = found(1), found(2)
    between = np.einsum("nia,ab,njb->ij", first, SPREAD, second)
    assert joined(3).covariance[rows(1), rows(2)] == pytest.approx(between, rel=1e-9)


def test_the_mean_turn_of_many_is_no_surer_than_the_own_tracks() -> None:
    """All know own errors alike; the true variance of the mean is that of its gains.

    Within a fifth: what each has of them is worked out as if those before had served at once.
    """
    count = len(PLACES_M)
    joint = joined(count)
    turns = WIDTH * np.arange(1, count) + 2
    claimed = joint.covariance[np.ix_(turns, turns)].mean()
    mean_gain = np.mean([found(carrier)[1][:, 2] for carrier in range(1, count)], axis=0)
    by_own = np.einsum("na,ab,nb->", mean_gain, SPREAD, mean_gain)
    alone = [
        found(carrier)[0].covariance[2, 2]
        - np.einsum("na,ab,nb->", found(carrier)[1][:, 2], SPREAD, found(carrier)[1][:, 2])
        for carrier in range(1, count)
    ]
    true = by_own + np.sum(alone) / (count - 1) ** 2
    assert claimed == pytest.approx(true, rel=0.2)
    assert np.linalg.eigvalsh(joint.covariance)[0] > -1e-9


def test_a_frame_found_through_another_hangs_on_the_tracks_of_that() -> None:
    """Noise of carrier 1 moves its own frame one way and, seen from it, the next the other way."""
    first, gain_own = found(1)
    joint = own_alone(0.0, 0.0).joined_by(first, 0.0, 0.0)
    turn, count = rotation_clockwise(TURNS_RAD[1]), len(TARGETS_M)
    away = turn.T @ (PLACES_M[2] - PLACES_M[1])
    in_own = found(2)[0].covariance
    seen = OwnAxesFrame(away, np.array(TURNS_RAD[2] - TURNS_RAD[1]), in_own)
    every = np.broadcast_to(SPREAD, (count, 2, 2))
    gain = gains(seen, every, seen_by(2), every)
    tracks = Tracks(
        carrier=np.repeat([0, 1], count),
        target=np.tile(np.arange(count), 2),
        places_m=np.vstack([seen_by(0), seen_by(1)]),
        covariance=np.broadcast_to(SPREAD, (2 * count, 2, 2)),
    )
    common = shared(joint, tracks, 1, seen, gain)
    between = -np.einsum("nia,ab,bc,njc->ij", gain_own, turn, SPREAD, gain)
    assert common[rows(1)] == pytest.approx(between, rel=1e-9)
    whole = joint.joined_through(1, seen, 0.0, 0.0, shared=common).covariance
    by_base = np.eye(3)
    by_base[:2, 2] = (turn @ away)[1], -(turn @ away)[0]
    by_seen = np.eye(3)
    by_seen[:2, :2] = turn
    expected = first.covariance @ by_base.T + between @ by_seen.T
    assert whole[rows(1), rows(2)] == pytest.approx(expected, rel=1e-9)


def test_a_frame_alone_has_nothing_in_common_with_anyone() -> None:
    assert not joined(2).covariance[rows(0)].any()
