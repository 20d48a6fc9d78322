"""What one Closed brought, counted: per source for `quality`, per target for `association`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from estimation.arrays import Array
from schemas.messages import AssociatedTarget, Input, SourceQuality, SourceReport

from .association import Method, Pair
from .sightings import Sightings
from .source_logs import Absorbed

_SUREST_FIRST: tuple[Method, ...] = ("operator", "identity", "coordinates")


@dataclass
class _Row:
    """Counts of one stream of one carrier."""

    logs: int = 0
    late: int = 0
    sigma_defaults: int = 0
    nis: float = 0.0
    nis_dof: int = 0
    associated: dict[str, None] = field(default_factory=dict)
    flags: dict[str, None] = field(default_factory=dict)


class _Match(NamedTuple):
    own: str
    other: str
    method: Method


class Tally:
    """Grows while a Closed is fused, and is read when its outputs are made."""

    def __init__(self) -> None:
        self._rows: dict[tuple[str, str], _Row] = {}
        self._matches: dict[str, list[_Match]] = {}
        self._seen: dict[str, dict[str, None]] = {}

    def fused(self, report: SourceReport, absorbed: Absorbed) -> None:
        """A report whose logs have been taken in."""
        row = self._row(report.carrier, report.stream)
        row.logs += absorbed.logs
        row.late += absorbed.superseded
        row.sigma_defaults += absorbed.sigma_defaults
        for name in absorbed.claimed_twice:
            row.flags[f"two logs claim {name}: not paired"] = None
        if absorbed.without_sigma:
            row.flags["logs without sigma, and no default: not used"] = None
        if absorbed.increments:
            row.flags["logs of kind increment: not used"] = None

    def unplaced(self, report: SourceReport) -> None:
        """A report that came before its carrier's first navigation."""
        row = self._row(report.carrier, report.stream)
        row.logs += len(report)
        row.flags[f"no navigation of {report.carrier} yet: not used"] = None

    def late(self, message: Input) -> None:
        """A message that is not fused because it is too old."""
        self._row(message.carrier, message.stream).late += _logs_of(message)

    def future(self, message: Input, ahead_s: float) -> None:
        """A message that is not fused because its stamp lies too far after the closing."""
        self._row(message.carrier, message.stream).flags[
            f"stamped {ahead_s:.3g} s after the closing: not fused"
        ] = None

    def registered(
        self,
        carriers: tuple[str, str],
        own: Sightings,
        other: Sightings,
        pairs: Sequence[Pair],
        nis: Array,
    ) -> None:
        """The pairs of one registration of (own, other) and their misclosures (L,)."""
        self._matches[carriers[1]] = [
            _Match(own.log[pair.own], other.log[pair.other], pair.method) for pair in pairs
        ]
        for carrier, logs in zip(carriers, (own, other), strict=True):
            fresh = (log for log, is_fresh in zip(logs.log, logs.fresh, strict=True) if is_fresh)
            self._seen[carrier] = dict.fromkeys(fresh)
        misclosures = nis.tolist()
        self._note(carriers[0], own, [pair.own for pair in pairs], misclosures)
        self._note(carriers[1], other, [pair.other for pair in pairs], misclosures)

    def _note(self, carrier: str, logs: Sightings, which: list[int], nis: list[float]) -> None:
        """What one carrier's logs had to do with a registration."""
        for i, squared in zip(which, nis, strict=True):
            row = self._row(carrier, logs.source[i])
            row.nis += squared
            row.nis_dof += 2
            if logs.fresh[i]:
                row.associated[logs.log[i]] = None

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
                nis=min(max(row.nis / row.nis_dof, 0.0), 1e18) if row.nis_dof else 0.0,
                nis_dof=row.nis_dof,
                flag="; ".join(row.flags)[:1024],
            )
            for (carrier, source), row in sorted(self._rows.items(), key=lambda item: item[0])
        ]

    def targets(self) -> list[AssociatedTarget]:
        """Logs by target: each own log with its partners in the last registration of each."""
        by_own: dict[str, list[_Match]] = {}
        for name in sorted(self._matches):
            for match in self._matches[name]:
                by_own.setdefault(match.own, []).append(match)
        return [
            AssociatedTarget(logs=[own, *(m.other for m in found)], method=_least_sure(found))
            for own, found in sorted(by_own.items())
        ]

    def alone(self) -> dict[str, int]:
        """Logs without a partner, by carrier, among the fresh ones of its last registration."""
        paired = {log for found in self._matches.values() for m in found for log in m[:2]}
        return {
            carrier: sum(log not in paired for log in self._seen[carrier])
            for carrier in sorted(self._seen)
        }

    def _row(self, carrier: str, stream: str) -> _Row:
        if (carrier, stream) not in self._rows:
            self._rows[carrier, stream] = _Row()
        return self._rows[carrier, stream]


def _least_sure(found: Iterable[_Match]) -> Method:
    return max((match.method for match in found), key=_SUREST_FIRST.index)


def _logs_of(message: Input) -> int:
    return len(message) if isinstance(message, SourceReport) else 1
