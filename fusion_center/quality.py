"""What one Closed brought, counted: per source for `quality`, per target for `association`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from estimation.arrays import Array
from schemas.messages import (
    AssociatedTarget,
    FeatureQuality,
    Input,
    Ranging,
    SourceQuality,
    SourceReport,
)

from .sources.logs import Absorbed
from .sources.sightings import Method, Pair, Sightings

MOST_NIS = 1e12
"""No single misclosure counts for more."""
_SUREST_FIRST: tuple[Method, ...] = ("operator", "identity", "coordinates")


@dataclass
class _Row:
    """Counts of one stream of one carrier."""

    logs: int = 0
    late: int = 0
    sigma_defaults: int = 0
    unknown_corrections: int = 0
    nis: float = 0.0
    nis_dof: int = 0
    taken: int = 0
    lone: int = 0
    track_nis: float = 0.0
    track_nis_dof: int = 0
    associated: set[str] = field(default_factory=set)
    features: dict[str, FeatureQuality] = field(default_factory=dict)
    flags: dict[str, None] = field(default_factory=dict)


class Look(NamedTuple):
    """What one report had to do with the tracks.

    Attributes:
        taken, lone: plots that are of a track, and of none.
        nis: summed over the taken; dof: degrees of freedom of it.
    """

    taken: int
    lone: int
    nis: float
    dof: int


class _Match(NamedTuple):
    target: str
    own_log: str
    other_log: str
    method: Method
    by_place: float
    by_features: float


class Tally:
    """Grows while a Closed is fused, and is read when its outputs are made.

    A log is paired in the Closed of its registration, which may be the one after it was fused, and
    several registrations may meet different logs of one target: targets are counted, not logs.
    """

    def __init__(self) -> None:
        self._rows: dict[tuple[str, str], _Row] = {}
        self._matches: dict[tuple[str, str], list[_Match]] = {}
        self._seen: dict[str, tuple[str, ...]] = {}
        self._paired: dict[str, set[str]] = {}

    def fused(self, report: SourceReport, absorbed: Absorbed) -> None:
        """A report whose logs have been taken in."""
        row = self._row(report.carrier, report.stream)
        row.logs += absorbed.logs
        row.late += absorbed.superseded
        row.sigma_defaults += absorbed.sigma_defaults
        for name in absorbed.claimed_twice:
            row.flags[f"two logs claim {name}: not paired"] = None
        for name in absorbed.recycled:
            row.flags[f"{name} stands for another target now: its past is not used"] = None
        if absorbed.astray:
            row.flags["logs measured long before or after their report: not used"] = None
        if absorbed.without_sigma:
            row.flags["logs without sigma, and no default: not used"] = None
        if absorbed.increments:
            row.flags["increments that say nothing new of a place: not used"] = None

    def unplaced(self, report: SourceReport) -> None:
        """A report that came before its carrier's first navigation."""
        row = self._row(report.carrier, report.stream)
        row.logs += len(report)
        row.flags[f"no navigation of {report.carrier} yet: not used"] = None

    def disordered(self, report: SourceReport) -> None:
        """A report that is stamped before one that its source has sent earlier."""
        row = self._row(report.carrier, report.stream)
        row.flags["stamps jump: of two reports the one sent later is stamped earlier"] = None

    def unpictured(self, report: SourceReport) -> None:
        """A report of which the picture cannot take in anything."""
        row = self._row(report.carrier, report.stream)
        row.flags["numbers beyond reason: not in the picture"] = None

    def ungrouped(self, report: SourceReport, why: str) -> None:
        """A report of a member of the group that tells nothing of the joint state."""
        self._row(report.carrier, report.stream).flags[f"{why}: not in the joint state"] = None

    def strained(self, carrier: str, source: str, why: str) -> None:
        """A source whose plots do not go with those of others as it declares itself."""
        self._row(carrier, source).flags[why] = None

    def wrong_link(self, ranging: Ranging, error_m: float, sigma_m: float) -> None:
        """A range of a link that is believed to err by the same amount all the time."""
        told = f"ranges to {ranging.peer} are {error_m:.3g} m too long (sigma {sigma_m:.2g} m)"
        self._row(ranging.carrier, ranging.stream).flags[f"{told}: taken out"] = None

    def late(self, message: Input) -> None:
        """A message that is not fused because it is too old."""
        self._row(message.carrier, message.stream).late += _logs_of(message)

    def unknown_correction(self, message: Input, why: str) -> None:
        """A message that holds a correction which cannot be taken out of it."""
        row = self._row(message.carrier, message.stream)
        row.unknown_corrections += 1
        row.flags[f"{why}: not used"] = None

    def future(self, message: Input, ahead_s: float) -> None:
        """A message that is not fused because its stamp lies too far after the closing."""
        self._row(message.carrier, message.stream).flags[
            f"stamped {ahead_s:.3g} s after the closing: not fused"
        ] = None

    def pictured(self, report: SourceReport, seen: Look, flags: Iterable[str]) -> None:
        """What a report had to do with the tracks of the picture, and what is odd about it."""
        row = self._row(report.carrier, report.stream)
        row.taken += seen.taken
        row.lone += seen.lone
        row.track_nis += seen.nis
        row.track_nis_dof += seen.dof
        row.flags.update(dict.fromkeys(flags))

    def learned(
        self, report: SourceReport, found: Mapping[str, FeatureQuality], flags: Iterable[str]
    ) -> None:
        """How well the source of a report tells features, and what is odd about it."""
        row = self._row(report.carrier, report.stream)
        row.features.update(found)
        row.flags.update(dict.fromkeys(flags))

    def registered(
        self,
        carriers: tuple[str, str],
        own: Sightings,
        other: Sightings,
        pairs: Sequence[Pair],
        nis: Array,
    ) -> None:
        """The pairs of one registration of (own, other) and their misclosures (L,)."""
        self._matches.pop(carriers, None)  # the order is that of the last registrations
        self._matches[carriers] = [
            _Match(own.target(p.own), own.log[p.own], other.log[p.other], *p[2:]) for p in pairs
        ]
        for carrier, logs in zip(carriers, (own, other), strict=True):
            fresh = (i for i, is_fresh in enumerate(logs.fresh) if is_fresh)
            self._seen[carrier] = tuple(logs.target(i) for i in fresh)
        misclosures = nis.tolist()
        self._note(carriers[0], own, [pair.own for pair in pairs], misclosures)
        self._note(carriers[1], other, [pair.other for pair in pairs], misclosures)

    def _note(self, carrier: str, logs: Sightings, which: list[int], nis: list[float]) -> None:
        """What one carrier's logs had to do with a registration."""
        for i, squared in zip(which, nis, strict=True):
            row = self._row(carrier, logs.source[i])
            row.nis += squared
            row.nis_dof += 2
            self._paired.setdefault(carrier, set()).add(logs.target(i))
            if logs.fresh[i]:
                row.associated.add(logs.target(i))

    def sources(self) -> list[SourceQuality]:
        """Every stream that had anything to count."""
        return [
            SourceQuality(
                carrier=carrier,
                source=source,
                logs=row.logs,
                late=row.late,
                associated=len(row.associated),
                sigma_defaults=row.sigma_defaults,
                unknown_corrections=row.unknown_corrections,
                nis=_per_degree(row.nis, row.nis_dof),
                nis_dof=row.nis_dof,
                taken=row.taken,
                lone=row.lone,
                track_nis=_per_degree(row.track_nis, row.track_nis_dof),
                track_nis_dof=row.track_nis_dof,
                features=row.features,
                flag="; ".join(row.flags)[:1024],
            )
            for (carrier, source), row in sorted(self._rows.items(), key=lambda item: item[0])
        ]

    def targets(self) -> list[AssociatedTarget]:
        """Targets of the own carrier: its newest log, and its partner in each registration."""
        by_target: dict[str, list[_Match]] = {}
        for matches in self._matches.values():
            for match in matches:
                by_target.setdefault(match.target, []).append(match)
        targets = [
            AssociatedTarget(
                logs=[found[-1].own_log, *sorted(match.other_log for match in found)],
                method=_least_sure(found),
                **_split(found),
            )
            for found in by_target.values()
        ]
        return sorted(targets, key=lambda target: target.logs)

    def alone(self) -> dict[str, int]:
        """Targets without a partner, by carrier, in the report of its last registration."""
        return {
            carrier: sum(target not in self._paired.get(carrier, ()) for target in seen)
            for carrier, seen in sorted(self._seen.items())
        }

    def _row(self, carrier: str, stream: str) -> _Row:
        if (carrier, stream) not in self._rows:
            self._rows[carrier, stream] = _Row()
        return self._rows[carrier, stream]


def _per_degree(nis: float, dof: int) -> float:
    return min(max(nis / dof, 0.0), 1e18) if dof else 0.0


def _split(found: Iterable[_Match]) -> dict[str, float]:
    """What coordinates and features say of the least sure pair, where features say anything."""
    told = [match for match in found if match.by_features]
    if not told:
        return {}
    worst = min(told, key=lambda match: match.by_place + match.by_features)
    return {
        "log_ratio_coordinates": worst.by_place,
        "log_ratio_features": worst.by_features,
    }


def _least_sure(found: Iterable[_Match]) -> Method:
    return max((match.method for match in found), key=_SUREST_FIRST.index)


def _logs_of(message: Input) -> int:
    return len(message) if isinstance(message, SourceReport) else 1
