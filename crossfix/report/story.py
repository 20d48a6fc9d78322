"""What a recording tells, read once: everything the picture and its figures are made of."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from crossfix.evaluation import Judge, PictureError, true_beacons_m
from crossfix.evaluation.recordings import own_carrier
from estimation.arrays import Array
from schemas import keys
from schemas import messages as m
from schemas.errors import RecordingError, WireError
from schemas.recording.contents import truth_of
from schemas.recording.reader import Recorded, Summary, open_recording, summary

from .thinning import Thinned

LOGS_PER_SOURCE = 8_000
TARGET_POINTS = 40_000
TRACK_POINTS = 40_000
"""Bounds of what is drawn, so that a page stays small whatever the run was."""

Source = tuple[str, str]
"""Carrier and source id."""


class Story(NamedTuple):
    """A recording, decoded, in the order of its file.

    Attributes:
        own: the carrier whose axes the picture is in.
        start_ns: the zero of all time axes.
        end_ns: of the last Closed, or of the last of anything.
        navigation: by carrier.
        reports: of every source, thinned.
        corrections: by carrier.
        truth_carriers: empty where the run was no simulation.
        pictures: thinned; last_picture: the last of all, None where there is none.
        picture_errors: of every picture of which the truth is known.
        alignments: what beacons and ranges tell.
        true_beacons_m: (3,) of each, where the truth is known.
        qualities: how each source did.
        flags: what looked wrong with a source, and at how many Closed messages.
        unreadable: messages that could not be decoded.
        damage: where reading ended before the file did; empty if it did not.
    """

    summary: Summary
    scenario: m.DeclaredScenario
    own: str
    start_ns: int
    end_ns: int
    navigation: Mapping[str, Sequence[m.Navigation]]
    sources: Mapping[Source, m.SourceProperties]
    reports: Mapping[Source, Thinned[m.SourceReport]]
    corrections: Mapping[str, Sequence[m.Correction]]
    truth_carriers: Sequence[m.TruthCarriers]
    truth_targets: Thinned[m.TruthTargets]
    pictures: Thinned[m.Tracks]
    last_picture: m.Tracks | None
    picture_errors: Sequence[PictureError]
    alignments: Sequence[m.Alignment]
    true_beacons_m: Mapping[str, Array]
    qualities: Sequence[m.Quality]
    closings: Sequence[m.Closed]
    health: Sequence[m.Health]
    states: Mapping[str, Sequence[m.ProcessState]]
    events: Sequence[m.Event]
    flags: Mapping[tuple[str, str, str], int]
    unreadable: int
    damage: str

    @property
    def carriers(self) -> tuple[str, ...]:
        """Own carrier first, then the declared ones, then strangers by name."""
        declared = [carrier.name for carrier in self.scenario.carriers]
        strangers = sorted({*self.navigation, *self.corrections, *(c for c, _ in self.reports)})
        return tuple(dict.fromkeys((self.own, *declared, *strangers)))

    @property
    def others(self) -> tuple[str, ...]:
        """All carriers but the own one."""
        return self.carriers[1:]

    @property
    def has_truth(self) -> bool:
        """Whether the truth of the own carrier is known, into whose frame all truth is mapped."""
        return any(self.own in truth.carrier for truth in self.truth_carriers[:1])

    def time_s(self, t_ns: int) -> float:
        """An instant on the time axes [s]."""
        return (t_ns - self.start_ns) * 1e-9

    def step_s(self, step: int) -> float:
        """When a step was closed, on the time axes [s]; 0 before the first."""
        end = bisect_right(self.closings, step, key=lambda closed: closed.step)
        return self.time_s(self.closings[end - 1].t_ns) if end else 0.0


def read_story(path: Path) -> Story:
    """Read a recording, finished or not; where it is damaged, what lies before the damage.

    Raises:
        RecordingError: no recording, or one without its scenario.
    """
    damage = ""
    with open_recording(path) as recording:
        scenario = recording.scenario
        teller = _Teller(scenario, true_beacons_m(truth_of(recording.attachments)))
        try:
            for message in recording.messages(topics=_TOLD):
                teller.hear(message)
        except RecordingError as error:
            damage = str(error)
    return teller.story(summary(path), damage)


class _Teller:
    """Takes messages in and sorts them."""

    def __init__(self, scenario: m.DeclaredScenario, true_beacons: Mapping[str, Array]) -> None:
        self._scenario, self._true_beacons_m = scenario, true_beacons
        self._judge = Judge(scenario, own_carrier(scenario))
        self._picture_errors: list[PictureError] = []
        self._pictures = Thinned[m.Tracks](TRACK_POINTS)
        self._last_picture: m.Tracks | None = None
        self._navigation: dict[str, list[m.Navigation]] = defaultdict(list)
        self._sources: dict[Source, m.SourceProperties] = {}
        self._reports: dict[Source, Thinned[m.SourceReport]] = {}
        self._corrections: dict[str, list[m.Correction]] = defaultdict(list)
        self._truth_carriers: list[m.TruthCarriers] = []
        self._truth_targets = Thinned[m.TruthTargets](TARGET_POINTS)
        self._alignments: list[m.Alignment] = []
        self._qualities: list[m.Quality] = []
        self._closings: list[m.Closed] = []
        self._health: list[m.Health] = []
        self._states: dict[str, list[m.ProcessState]] = defaultdict(list)
        self._events: list[m.Event] = []
        self._flags: Counter[tuple[str, str, str]] = Counter()
        self._unreadable = 0
        self._last_ns = 0
        self._takers: dict[keys.Topic, Callable[..., object]] = {
            keys.NAVIGATION: self._hear_navigation,
            keys.SOURCE: lambda i: self._sources.update({(i.carrier, i.source): i.properties}),
            keys.CORRECTION: lambda c: self._corrections[c.carrier].append(c),
            keys.TRUTH_CARRIERS: self._hear_truth,
            keys.TRUTH_TARGETS: self._hear_targets,
            keys.TRACK: self._hear_picture,
            keys.CLOSED_FUSION: self._closings.append,
            keys.HEALTH: self._health.append,
            keys.STATE: lambda s: self._states[s.process].append(s),
            keys.EVENT: self._events.append,
            keys.QUALITY: self._hear_quality,
            keys.ALIGNMENT: self._alignments.append,
        }

    def hear(self, message: Recorded) -> None:
        """Take one message in."""
        self._last_ns = max(self._last_ns, message.log_time_ns)
        if message.address.topic is keys.REPORT:
            source = message.address.ids["carrier"], message.address.ids["source"]
            thinned = self._reports.setdefault(source, Thinned(LOGS_PER_SOURCE))
            if thinned.wants_next() and (report := self._decoded(message)) is not None:
                thinned.keep(report, len(report))
        elif (decoded := self._decoded(message)) is not None:
            self._takers[message.address.topic](decoded)

    def story(self, summary: Summary, damage: str) -> Story:
        """All that was heard."""
        scenario = self._scenario
        declared = {(c.name, s): p for c in scenario.carriers for s, p in c.sources.items()}
        closings = sorted(self._closings, key=lambda closed: closed.step)
        start_ns = self._start_ns(scenario)
        return Story(
            summary=summary,
            scenario=scenario,
            own=own_carrier(scenario),
            start_ns=start_ns,
            end_ns=max(start_ns, closings[-1].t_ns if closings else self._last_ns),
            navigation=dict(self._navigation),
            sources=declared | self._sources,
            reports=self._reports,
            corrections={
                name: sorted(corrections, key=lambda c: c.step)
                for name, corrections in self._corrections.items()
            },
            truth_carriers=sorted(self._truth_carriers, key=lambda truth: truth.step),
            truth_targets=self._truth_targets,
            pictures=self._pictures,
            last_picture=self._last_picture,
            picture_errors=self._picture_errors,
            alignments=self._alignments,
            true_beacons_m=self._true_beacons_m,
            qualities=self._qualities,
            closings=closings,
            health=self._health,
            states=dict(self._states),
            events=self._events,
            flags=self._flags,
            unreadable=self._unreadable,
            damage=damage,
        )

    def _start_ns(self, scenario: m.DeclaredScenario) -> int:
        """The scenario's epoch, unless the clock of the run knows nothing of it."""
        first = min((c.t_ns for c in self._closings), default=scenario.epoch_ns)
        within = 0 <= first - scenario.epoch_ns <= scenario.step_ns * scenario.steps
        return scenario.epoch_ns if within else first

    def _hear_navigation(self, navigation: m.Navigation) -> None:
        self._navigation[navigation.carrier].append(navigation)
        self._picture_errors += self._judge.errors(navigation)

    def _hear_truth(self, truth: m.TruthCarriers) -> None:
        self._truth_carriers.append(truth)
        self._picture_errors += self._judge.errors(truth)

    def _hear_targets(self, targets: m.TruthTargets) -> None:
        self._picture_errors += self._judge.errors(targets)
        if self._truth_targets.wants_next():
            self._truth_targets.keep(targets, len(targets.number))

    def _hear_picture(self, picture: m.Tracks) -> None:
        self._picture_errors += self._judge.errors(picture)
        self._last_picture = picture
        if self._pictures.wants_next():
            self._pictures.keep(picture, len(picture.tracks))

    def _decoded(self, message: Recorded) -> Any:
        try:
            return message.decode()
        except WireError:
            self._unreadable += 1
            return None

    def _hear_quality(self, quality: m.Quality) -> None:
        self._qualities.append(quality)
        for source in quality.sources:
            if source.flag:
                self._flags[source.carrier, source.source, source.flag] += 1


_TOLD = (
    keys.NAVIGATION, keys.SOURCE, keys.REPORT, keys.CORRECTION, keys.TRUTH_CARRIERS,
    keys.TRUTH_TARGETS, keys.TRACK, keys.CLOSED_FUSION, keys.HEALTH, keys.STATE, keys.EVENT,
    keys.QUALITY, keys.ALIGNMENT,
)  # fmt: skip
