"""Features of the tracks of sources: gathered, kept, and heard when carriers are compared."""

from __future__ import annotations

import numpy as np
import pytest

from bench.joint_fusion.frames import TELLS, crowd, found, lengths, view
from estimation.relative_frame import OwnAxesFrame
from estimation.tracking.features import WRONG, Features, Layout
from fusion_center.relative_frames.association import associate
from fusion_center.relative_frames.views import View
from fusion_center.sources.telling import (
    Telling,
    after_logs,
    packed,
    refitted,
    telling,
    unpacked,
)
from fusion_center.state import Dictionary, Orders
from schemas.messages import FeatureInfo, SourceProperties
from tests.fusion_center.test_features import KNOWN, LENGTH, SOURCE, heard_of, state_of

NO_ORDERS = Orders()


def test_rows_are_columns_and_back() -> None:
    rng = np.random.default_rng(1)
    known = Features(*rng.random((3, 2, 5)), rng.random((3, 5)))
    for part, back in zip(known, unpacked(packed(known), Layout(2, (3,))), strict=True):
        np.testing.assert_array_equal(part, back)


def test_logs_are_taken_in_where_their_tracks_are() -> None:
    """Three logs: of the second track, of a new one, of the first; then nothing said of one."""
    first = heard_of({"length_m": [100.0, 50.0], "emitter": ["s", "x"]})
    every = np.arange(2)
    rows = after_logs(np.zeros((0, 6)), np.full(2, -1), every, first, KNOWN)
    more = heard_of({"length_m": [52.0, 200.0, None], "emitter": [None, None, "s"]})
    after = after_logs(rows, np.array([1, -1, 0]), np.arange(3), more, KNOWN)
    found = unpacked(after, Layout(1, (3,)))
    np.testing.assert_allclose(found.mean[0], [51.0, 200.0, 100.0], atol=0.3)
    assert found.shares[:, 2].argmax() == 0
    assert found.shares[0, 2] > found.shares[0].max(initial=0.0, where=[True, True, False])
    np.testing.assert_allclose(found.shares[:, 1], 1 / 3)
    silent = after_logs(rows, np.array([1]), np.zeros(1, dtype=np.intp), None, KNOWN)
    np.testing.assert_array_equal(silent[0], rows[1])


def test_rows_of_another_dictionary_keep_what_both_know() -> None:
    rows = after_logs(
        np.zeros((0, 6)), np.full(1, -1), np.zeros(1, dtype=np.intp),
        heard_of({"length_m": [100.0]}), KNOWN,
    )  # fmt: skip
    more = Dictionary(("beam_m", "length_m"), KNOWN.words)
    assert unpacked(refitted(rows, KNOWN, more), Layout(2, (3,))).mean[1] == pytest.approx(100.0)
    assert refitted(rows, KNOWN, KNOWN) is rows


def test_numbers_range_as_widely_as_any_source_says() -> None:
    wide = FeatureInfo(kind="parametric", sigma=8.0, population=[-100.0, 500.0])
    state = state_of(SOURCE, SourceProperties(features={"length_m": wide, "beam_m": LENGTH}))
    tells = telling(state)
    np.testing.assert_array_equal(tells.width, [400.0, 600.0])
    assert tells.layout == Layout(2, (3,))


HERE = OwnAxesFrame(np.zeros(2), np.zeros(()), np.diag([5.0, 5.0, 1e-4]) ** 2)
NEAR = np.array([[5000.0, 4000.0], [5060.0, 4000.0]])


def paired(own: View, other: View, tells: Telling = TELLS) -> set[tuple[int, int]]:
    return {(p.own, p.other) for p in associate(own, other, NO_ORDERS, HERE, 9.21, tells)}


def test_coordinates_are_overruled_by_features_that_differ() -> None:
    """Two targets side by side, the noise of one carrier has swapped them."""
    own, other = view(NEAR, lengths([30, 200]), "a"), view(NEAR, lengths([200, 30]), "b")
    assert paired(own, other) == {(0, 1), (1, 0)}
    unheard = Telling(Layout(), np.zeros(0))
    blind = [view(NEAR, np.zeros((2, 0)), name) for name in "ab"]
    assert paired(*blind, unheard) == {(0, 0), (1, 1)}
    silent = view(NEAR, lengths([np.nan] * 2), "b")
    assert paired(own, silent) == {(0, 0), (1, 1)}


def test_places_and_features_are_weighed_together() -> None:
    """Lengths a little apart that rule no pair out: nearly alike they yield to the places."""
    own = view(NEAR, lengths([30, 39]), "a")
    assert paired(own, view(NEAR, lengths([39, 30]), "b")) == {(0, 1), (1, 0)}
    assert paired(own, view(NEAR, lengths([34, 35]), "b")) == {(0, 0), (1, 1)}
    assert paired(own, view(NEAR, lengths([35, 34]), "b")) == {(0, 0), (1, 1)}


def test_two_targets_at_one_place_are_not_one() -> None:
    own, other = view(NEAR[:1], lengths([30]), "a"), view(NEAR[:1], lengths([300]), "b")
    assert paired(own, other) == set()


def test_a_pair_says_what_places_and_features_have_said() -> None:
    own, other = view(NEAR[:1], lengths([30]), "a"), view(NEAR[:1], lengths([32]), "b")
    pair = associate(own, other, NO_ORDERS, HERE, 9.21, TELLS)[0]
    assert pair.by_place == pytest.approx(9.21 / 2)
    density = [np.exp(-2 / 18 / s) / np.sqrt(2 * np.pi * 18 * s) for s in (1, 4, 16)]
    expected = np.log(WRONG + (1 - WRONG) * np.mean(density) * 400)
    assert pair.by_features == pytest.approx(expected, rel=1e-3)


def test_operators_overrule_features() -> None:
    own, other = view(NEAR, lengths([30, 200]), "a"), view(NEAR, lengths([200, 30]), "b")
    bound = Orders(bound=(("a/radar/t0", "b/radar/t0"),))
    pairs = associate(own, other, bound, HERE, 9.21, TELLS)
    assert (0, 0, "operator") in {p[:3] for p in pairs}
    forbidden = Orders(forbidden=(("a/radar/t0", "b/radar/t1"),))
    pairs = associate(own, other, forbidden, HERE, 9.21, TELLS)
    assert (0, 1) not in {p[:2] for p in pairs}


def test_frames_are_found_sooner_where_features_tell_targets_apart() -> None:
    seeds = [np.random.default_rng([1, k]) for k in range(6)]
    with_features = [found(crowd(rng, 3.0)) for rng in seeds]
    blind = [found(crowd(rng, None)) for rng in seeds]
    assert all(p > 0.99 and right == pairs for p, right, pairs in with_features)
    assert sum(p > 0.99 for p, _, _ in blind) < 6


def test_features_that_err_more_than_stated_find_no_wrong_frame() -> None:
    every = [found(crowd(np.random.default_rng([2, k]), 15.0)) for k in range(6)]
    assert all(right > pairs / 2 for p, right, pairs in every if p > 0.99)
