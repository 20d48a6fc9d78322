"""What reports say of features, what pairs teach of them, and what is told of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.tracking import features
from estimation.tracking.bernoulli import none
from estimation.tracking.features import Features, unknown
from estimation.tracking.tracker import Association, Picture, nothing
from estimation.tracking.tracker import Settings as Tracker
from fusion_center.picture import learning
from fusion_center.settings import Settings
from fusion_center.sources.features import (
    MOST,
    NOTHING_LEARNED,
    dictionary,
    fitted,
    heard,
    layout,
    scale_of,
)
from fusion_center.state import Dictionary, Learned, Scale, State, Word
from schemas.messages import (
    DeclaredCarrier,
    DeclaredScenario,
    FeatureColumn,
    FeatureInfo,
    Origin,
    SourceProperties,
    SourceReport,
)

CONFUSION = [[0.9, 0.05, 0.05], [0.05, 0.9, 0.05], [0.05, 0.05, 0.9]]
LENGTH = FeatureInfo(kind="parametric", unit="m", sigma=8.0, population=[0.0, 400.0])
EMITTER = FeatureInfo(kind="behavioural", categories=["s", "x", "off"], confusion=CONFUSION)
SOURCE = SourceProperties(features={"length_m": LENGTH, "emitter": EMITTER})
KNOWN = Dictionary(("length_m",), (Word("emitter", ("s", "x", "off")),))
Values = list[float | str | None]


def report(columns: dict[str, Values], sigmas: list[float | None] | None = None) -> SourceReport:
    count = len(next(iter(columns.values())))
    told = {name: FeatureColumn(values=values) for name, values in columns.items()}
    if sigmas is not None:
        told["length_m"] = FeatureColumn(values=columns["length_m"], sigmas=sigmas)
    return SourceReport(
        carrier="own", boot="b", stream="radar", seq=1, t_ns=1,
        bearing_rad=[0.1] * count, range_m=[1e4] * count, features=told,
    )  # fmt: skip


def heard_of(columns: dict[str, Values], source: SourceProperties = SOURCE, **more: Any) -> Any:
    said = report(columns, more.pop("sigmas", None))
    return heard(said, np.arange(len(said)), source, KNOWN, **more)


def state_of(*sources: SourceProperties) -> State:
    carriers = [
        DeclaredCarrier(
            name=f"c{k}", sigma_position_m=1.0, sigma_north_rad=0.1, sources={"radar": source}
        )
        for k, source in enumerate(sources)
    ]
    origin = Origin(latitude_rad=0.7, longitude_rad=0.5)
    scenario = DeclaredScenario(
        name="test", origin=origin, epoch_ns=0, step_ns=1, steps=1, carriers=carriers
    )
    return State(centre="fusion", own="c0", scenario=scenario, settings=Settings())


def test_numbers_are_read_with_their_sigmas() -> None:
    said = heard_of({"length_m": [100.0, 50.0, None, "long", 450.0]}, sigmas=[4.0, None, 1, 1, 1])
    value, variance = said.said.value[0], said.said.variance[0]
    np.testing.assert_array_equal(value, [100.0, 50.0, np.nan, np.nan, np.nan])
    np.testing.assert_allclose(variance[:2], [16.0, 64.0])
    assert said.said.width == 400.0


def test_a_value_a_little_out_of_its_population_is_one() -> None:
    said = heard_of({"length_m": [-15.0, 415.0, -45.0]})
    np.testing.assert_array_equal(np.isnan(said.said.value[0]), [False, False, True])


def test_what_is_learnt_is_used() -> None:
    learned = Learned(numbers={"length_m": Scale(weight=10.0, squares=90.0, stated=8.0)})
    said = heard_of({"length_m": [100.0]}, learned=learned)
    assert scale_of(learned, "length_m") == 9.0
    assert said.said.variance[0, 0] == pytest.approx(9 * 64.0)


def test_words_are_read_by_the_confusion_of_their_source() -> None:
    said = heard_of({"emitter": ["x", None, "unheard of", 3.0]})
    np.testing.assert_array_equal(said.words[0], [1, -1, -1, -1])
    expected = np.array([0.05, 0.9, 0.05]) / (1 / 3)
    np.testing.assert_allclose(said.said.likelihood[:, 0], expected, rtol=0.02)
    np.testing.assert_array_equal(said.said.likelihood[:, 1:], 1.0)


def test_what_a_source_does_not_declare_is_not_used() -> None:
    assert heard_of({"length_m": [100.0]}, SourceProperties()) is None
    open_ended = SourceProperties(features={"length_m": FeatureInfo(kind="parametric", sigma=8.0)})
    assert heard_of({"length_m": [100.0]}, open_ended) is None
    assert heard_of({"length_m": [None], "emitter": [None]}) is None


@pytest.mark.parametrize("confusion", [[], [[1.0, 0.0, 0.0]], [[0.0] * 3] * 3])
def test_a_confusion_that_is_none_is_not_believed(confusion: list[list[float]]) -> None:
    odd = FeatureInfo(kind="behavioural", categories=["s", "x", "off"], confusion=confusion)
    said = heard_of({"emitter": ["x"]}, SourceProperties(features={"emitter": odd}))
    assert np.isfinite(said.said.likelihood).all()
    assert (said.said.likelihood > 0).all()


def test_the_dictionary_is_that_of_all_sources() -> None:
    other = FeatureInfo(kind="behavioural", categories=["x", "hf"])
    classes = FeatureInfo(kind="parametric", categories=["cargo", "tanker"])
    endless = FeatureInfo(kind="parametric", sigma=1.0)
    more = {"emitter": other, "class": classes, "speed_mps": endless, "beam_m": LENGTH}
    known = dictionary(state_of(SOURCE, SourceProperties(features=more)))
    assert known.numbers == ("beam_m", "length_m")
    assert known.words == (Word("emitter", ("s", "x", "off", "hf")),)


def test_the_dictionary_is_bounded() -> None:
    many = {f"f{k:03}": LENGTH for k in range(100)}
    words = [
        FeatureInfo(kind="behavioural", categories=[f"{a}{k}" for k in range(60)]) for a in "ab"
    ]
    endless = FeatureInfo(kind="behavioural", categories=[f"w{k}" for k in range(1000)])
    more = {**many, "word": words[0], "endless": endless}
    known = dictionary(
        state_of(SourceProperties(features=more), SourceProperties(features={"word": words[1]}))
    )
    assert len(known.numbers) == MOST
    assert [word.name for word in known.words] == ["word"]
    assert len(known.words[0].categories) == 64
    assert dictionary(state_of()) == Dictionary()


def test_what_is_known_keeps_its_rows_when_features_are_added() -> None:
    rng = np.random.default_rng(1)
    old = Features(*rng.random((3, 1, 5)), rng.dirichlet(np.ones(3), 5).T)
    now = Dictionary(("beam_m", "length_m"), (Word("colour", ("a", "b")), KNOWN.words[0]))
    new = fitted(old, KNOWN, now)
    for part, kept in zip(new[:3], old[:3], strict=True):
        np.testing.assert_array_equal(part[1], kept[0])
    np.testing.assert_array_equal(new.shares[2:], old.shares)
    np.testing.assert_array_equal(new.unsaid[0], 1.0)
    np.testing.assert_array_equal(new.shares[:2], 0.5)
    back = fitted(new, now, KNOWN)
    for part, kept in zip(back, old, strict=True):
        np.testing.assert_array_equal(part, kept)


class School:
    """Many tracks whose features are known, and reports of each by a source that may err more."""

    def __init__(self, seed: int, tracks: int = 40) -> None:
        self.rng = np.random.default_rng(seed)
        self.length_m = self.rng.uniform(20, 300, tracks)
        self.emitter = self.rng.integers(3, size=tracks)
        self.learned = NOTHING_LEARNED
        self.tracks = unknown(layout(KNOWN), tracks)

    def teach(
        self, reports: int, sigma_m: float = 8.0, right: float = 0.9, probability: float = 0.9999
    ) -> Learned:
        """The tracks and what is learnt, after some reports."""
        every = np.arange(len(self.length_m))
        for _ in range(reports):
            words = np.where(
                self.rng.random(len(every)) < right,
                self.emitter,
                (self.emitter + self.rng.integers(1, 3, len(every))) % 3,
            )
            said = heard_of(
                {
                    "length_m": self.rng.normal(self.length_m, sigma_m).tolist(),
                    "emitter": [EMITTER.categories[k] for k in words],
                },
                learned=self.learned,
            )
            met = self.picture(every)
            certain = np.full(len(every), probability)
            done = Association(every, every, certain, np.zeros(len(every)), every)
            self.learned = learning.taught(self.learned, met, said, done, KNOWN, SOURCE, 1000.0)
            self.tracks = features.after(self.tracks, said.said, every, every)
        return self.learned

    def picture(self, every: Array) -> Picture:
        blank = nothing(Tracker(features=layout(KNOWN)), 0)
        return blank._replace(
            tracks=none(1, layout(KNOWN))._replace(identity=every, features=self.tracks)
        )


@pytest.mark.parametrize("sigma_m", [2.0, 8.0, 30.0])
def test_the_true_sigma_is_found_whatever_is_declared(sigma_m: float) -> None:
    school = School(2)
    found = learning.quality(school.teach(100, sigma_m=sigma_m), SOURCE)["length_m"]
    assert found.declared_sigma == pytest.approx(8.0)
    assert found.learned_sigma == pytest.approx(sigma_m, rel=0.12)
    told = " ".join(learning.flags({"length_m": found}))
    assert ("length_m errs" in told) == (sigma_m != 8.0)


@pytest.mark.parametrize("right", [0.6, 0.9])
def test_the_true_confusion_is_found_whatever_is_declared(right: float) -> None:
    school = School(3)
    found = learning.quality(school.teach(60, right=right), SOURCE)["emitter"]
    assert found.declared_right == pytest.approx(0.9, abs=1e-6)
    assert found.learned_right == pytest.approx(right, abs=0.05)
    told = " ".join(learning.flags({"emitter": found}))
    assert ("emitter is right" in told) == (right != 0.9)


def test_pairs_in_doubt_teach_nothing() -> None:
    school = School(4)
    found = learning.quality(school.teach(20, probability=0.3), SOURCE)
    assert found["length_m"].pairs < 1.0
    assert not list(learning.flags(found))


def test_a_source_that_mends_its_ways_is_believed_again() -> None:
    """What is learnt is bounded, so that it can change."""
    school = School(5)
    school.teach(60, sigma_m=30.0)
    learned = school.teach(150, sigma_m=8.0)
    assert learned.numbers["length_m"].weight <= 1000.0
    assert learned.words["emitter"].count.sum(axis=1).max() <= 1000.0 + 1e-9
    assert learning.quality(learned, SOURCE)["length_m"].learned_sigma == pytest.approx(8, rel=0.15)


def test_tracks_learn_new_features_as_sources_declare_them() -> None:
    state = learning.with_dictionary(state_of(SOURCE))
    assert state.picture.dictionary == KNOWN
    assert learning.with_dictionary(state) is state
