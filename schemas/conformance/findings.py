"""What can be wrong with a publisher, how bad it is, and what its author should do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Literal, NamedTuple

from msgspec import Struct

Severity = Literal["error", "warning"]


class Finding(Struct, frozen=True, kw_only=True):
    """One thing wrong with one source of one carrier.

    Attributes:
        code: which; a key of `CODES`.
        source: source id, or `navigation`, `ranging`, `info`, or empty for the whole carrier.
        count: how often.
        example: the first case, in words.
        advice: what to do.
    """

    code: str
    severity: Severity
    carrier: str
    source: str
    count: int
    example: str
    advice: str


class Code(NamedTuple):
    """A kind of finding."""

    severity: Severity
    advice: str


CODES: Mapping[str, Code] = {
    "key": Code(
        "error",
        "Publish on the plain keys of docs/wire.md: ids are [a-z0-9_-], 1 to 32 of them, never "
        "with a wildcard.",
    ),
    "name": Code(
        "error",
        "Choose another name: world, fusion, recorder, info, navigation, ranging are taken.",
    ),
    "encoding": Code(
        "warning",
        "Set the sample's encoding to application/msgpack;crossfix.MESSAGE, or application/json;"
        "crossfix.MESSAGE.",
    ),
    "payload": Code("error", "Send one MessagePack map with named fields (or JSON, and say so)."),
    "size": Code("error", "Send less at a time: several reports of some hundred logs each."),
    "schema": Code("error", "Correct the field; docs/wire.md lists its type, unit and limits."),
    "unknown_field": Code("warning", "Nobody reads this field: correct its name or leave it out."),
    "envelope": Code(
        "error", "Carrier, source and stream in the message must be those of the key it is put on."
    ),
    "ragged": Code(
        "error", "All columns of a report need one length; what a log lacks is nil in its cell."
    ),
    "not_finite": Code("error", "Never send NaN or infinity: what is unknown is nil."),
    "covariance": Code(
        "error", "Send the upper triangle, row by row, of a positive definite matrix."
    ),
    "degrees": Code("error", "Angles are radians: multiply by pi/180."),
    "kilometres": Code("error", "Ranges are metres: multiply by 1000."),
    "time_unit": Code("error", "t_ns counts nanoseconds since 1970-01-01 UTC, as an integer."),
    "time_future": Code(
        "error", "Stamp what was measured with the time of the run; later stamps are not fused."
    ),
    "time_past": Code(
        "error", "Stamp what was measured with the time of the run; nothing so old is fused."
    ),
    "time_backwards": Code(
        "error", "Within a stream t_ns must not decrease; what is older than fused is late."
    ),
    "time_repeated": Code("warning", "Give every report of a stream a stamp of its own."),
    "time_jitter": Code("warning", "Report at even intervals, or stamp when it was measured."),
    "rate": Code("error", "Declare in SourceInfo the period_s at which you really report."),
    "empty_reports": Code(
        "error", "Send a report without columns when the source looked and saw nothing."
    ),
    "seq_start": Code("error", "Begin every stream of a boot with seq 1."),
    "seq_missing": Code("error", "Count seq up by one within (boot, stream), leaving nothing out."),
    "seq_reused": Code(
        "error", "Never send two messages with one seq; a restarted process needs a new boot."
    ),
    "seq_repeated": Code("warning", "Send each message once: what was lost is asked for."),
    "two_processes": Code(
        "error", "Two lives of one carrier speak in turns: end one, or give it another name."
    ),
    "source_info": Code("error", "Send a SourceInfo for the source before its first report."),
    "source_unheard": Code(
        "warning",
        "Serve source/CARRIER/SOURCE, or start this before the publisher: what it declares of "
        "itself is not known, so its sigmas cannot be judged.",
    ),
    "coordinates": Code(
        "error", "Send the coordinates that SourceInfo declares, or declare those you send."
    ),
    "feature": Code("warning", "Declare the feature in SourceInfo with its kind, unit and sigma."),
    "navigation": Code(
        "error",
        "Send Navigation before the first report: it says where the carrier believes to be.",
    ),
    "prior": Code(
        "error", "Send pose.covariance: of a carrier the scenario does not know it is the prior."
    ),
    "sigma_missing": Code(
        "error", "Send sigmas, or declare the source's defaults: logs without either are not used."
    ),
    "sigma_zero": Code("error", "No measurement is exact: send its sigma, or nil for the default."),
    "sigma_absurd": Code("error", "Send one standard deviation, in the unit of the column."),
    "sigma_too_small": Code("error", "Claim larger sigmas: the measurements scatter more."),
    "sigma_too_large": Code(
        "warning",
        "Claim smaller sigmas: the measurements scatter less. A thousandth is another unit.",
    ),
    "range_limits": Code(
        "error", "Declare range_min_m and range_max_m within which the source really measures."
    ),
    "claimed_twice": Code(
        "error", "Within a report each identity and each track_id may name one log only."
    ),
    "track_reused": Code(
        "error", "Give a new target a new track_id (or identity): this one leapt across the scene."
    ),
    "correction_hidden": Code(
        "error",
        "Say what a corrected message is without its correction: Navigation correction_id and "
        "uncorrected, SourceReport correction_id and turned_rad.",
    ),
    "correction_name": Code(
        "error",
        "Name the id of the Correction that you have applied: one sent to this carrier, that "
        "carries feedback. When it carries none, drop what you had applied.",
    ),
    "correction_place": Code(
        "error",
        "Add feedback.latitude_rad and longitude_rad to the pose you have without any correction, "
        "and their rates for every second since valid_t_ns.",
    ),
    "correction_turn": Code(
        "error", "Add feedback.north_rad to every bearing, and say it in turned_rad."
    ),
    "correction_half": Code(
        "warning", "Turn what you report by feedback.north_rad too: pose and reports are one frame."
    ),
    "unanswered": Code(
        "error", "Set step to 0, or acknowledge each step on ack/CARRIER: else nothing is fused."
    ),
    "refused": Code(
        "error",
        "Listen while it publishes, `crossfix check --run RUN`: the recording has the reason only.",
    ),
    "token": Code(
        "error", "Declare the liveliness token alive/CARRIER/BOOT before the first message."
    ),
    "backfill": Code(
        "warning", "Serve backfill/CARRIER: whoever missed a message asks for it there."
    ),
    "latched": Code("warning", "Serve source/CARRIER/SOURCE: who comes late asks for it there."),
}
"""Every kind of finding."""


MAX_DETAILS = 20
OTHERS = "others"


class Notes:
    """Collects what is found, one row for a kind, a source and a detail."""

    def __init__(self, max_rows: int = 1000) -> None:
        self._max_rows = max_rows
        self._rows: dict[tuple[str, str, str, str], tuple[int, str]] = {}
        self._details: Counter[tuple[str, str, str]] = Counter()

    def add(
        self,
        code: str,
        carrier: str,
        source: str,
        example: str,
        *,
        detail: str = "",
        count: int = 1,
    ) -> None:
        """Count a case; its example is kept if it is the first.

        Args:
            detail: tells cases apart that are to be shown apart, such as a field's name.
        """
        row = (code, carrier, source, detail)
        if row not in self._rows:
            row = self._new_row(*row)
        before, first = self._rows.get(row, (0, example))
        self._rows[row] = (before + count, first)

    def copy(self) -> Notes:
        """The same, to be added to apart, with room for as much again."""
        other = Notes(2 * self._max_rows)
        other._rows, other._details = dict(self._rows), self._details.copy()
        return other

    def has(self, code: str, carrier: str, source: str) -> bool:
        """Whether there is any such finding."""
        return any(row[:3] == (code, carrier, source) for row in self._rows)

    def findings(self) -> list[Finding]:
        """Errors first, then by carrier and source."""
        found = [
            Finding(
                code=code,
                severity=CODES[code].severity,
                carrier=carrier,
                source=source,
                count=count,
                example=example,
                advice=CODES[code].advice,
            )
            for (code, carrier, source, _), (count, example) in self._rows.items()
        ]
        return sorted(found, key=lambda f: (f.severity, f.carrier, f.source, f.code, f.example))

    def _new_row(
        self, code: str, carrier: str, source: str, detail: str
    ) -> tuple[str, str, str, str]:
        """A row of its own while there is room; names come from the wire and may be anything."""
        if len(self._rows) >= self._max_rows:
            return code, OTHERS, OTHERS, OTHERS
        name = (code, carrier, source)
        if self._details[name] >= MAX_DETAILS:
            return *name, OTHERS
        self._details[name] += 1
        return *name, detail
