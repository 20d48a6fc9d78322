"""Where the targets of a carrier are at one instant, by the last two logs of each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array

from ..navigation import NS
from ..settings import LogSettings
from ..state import SourceLogs
from .reading import round_covariance


@dataclass(frozen=True, eq=False, slots=True)
class Sightings:
    """Target logs of one carrier at one instant, n of them.

    Attributes:
        log, source: id of the newest log behind each, and the source that brought it.
        fresh: whether that log is of the newest report of its source.
        identity, track: kind/name others see too; carrier/source/track_id; either may be empty.
        east_north_m: (n, 2) from the carrier's reported position, in its believed axes.
        covariance: (n, 2, 2) [m^2].
        altitude_m: (n,) above the ellipsoid.
        features: (n, columns) what is known of them, see `telling`.
    """

    log: tuple[str, ...]
    source: tuple[str, ...]
    fresh: tuple[bool, ...]
    identity: tuple[str, ...]
    track: tuple[str, ...]
    east_north_m: Array
    covariance: Array
    altitude_m: Array
    features: Array

    def target(self, i: int) -> str:
        """What the i-th is called within its carrier, the same from log to log if it has a name."""
        return self.identity[i] or self.track[i] or self.log[i]


Method = Literal["operator", "identity", "coordinates"]


class Pair(NamedTuple):
    """Which of the own logs and which of the other carrier's, and why.

    Attributes:
        by_place, by_features: what each adds to the log-likelihood ratio on which coordinates and
            features have decided together; 0 of other methods.
    """

    own: int
    other: int
    method: Method
    by_place: float = 0.0
    by_features: float = 0.0


def at_instant(
    logs: SourceLogs, t_ns: int, settings: LogSettings
) -> tuple[NDArray[np.intp], Array, Array]:
    """Targets at an instant, by the straight line through their last two logs.

    With weights a = (t - t1) / (t2 - t1) and 1 - a the covariance is a^2 C2 + (1 - a)^2 C1, and
    what an acceleration would add to the line, half of it times (t - t1) (t - t2). A target of
    which there is one log only stays where it was, its velocity unknown.

    Returns:
        which targets are young enough (m,), their places (m, 2) and covariances (m, 2, 2).
    """
    after_s = (t_ns - logs.t_ns[0]) * NS
    two = logs.t_ns[1] >= 0
    gap_s = np.where(two, (logs.t_ns[0] - logs.t_ns[1]) * NS, 1.0)
    limit_s = np.where(two, settings.max_age_s, settings.single_max_age_s)
    which = np.flatnonzero(np.abs(after_s) <= limit_s)

    after_s, two, gap_s = after_s[which], two[which], gap_s[which]
    a = np.where(two, 1 + after_s / gap_s, 1.0)
    curved_m = settings.sigma_acceleration_mps2 / 2 * after_s * (after_s + gap_s)
    wandered_m = settings.sigma_velocity_mps * after_s
    newest, before = logs.place_m[:, which]
    c2, c1 = logs.covariance[:, which]
    place = a[:, None] * newest + (1 - a)[:, None] * before
    covariance = (a**2)[:, None, None] * c2 + ((1 - a) ** 2)[:, None, None] * c1
    return which, place, covariance + round_covariance(np.where(two, curved_m, wandered_m) ** 2)


def sightings(
    carrier: str,
    boot: int,
    logs: Mapping[str, SourceLogs],
    t_ns: int,
    way_m: Array,
    settings: LogSettings,
) -> Sightings:
    """All targets of a carrier at one instant, source by source in the order of their names.

    Args:
        boot: ordinal of the carrier's life, part of a log's id.
        way_m: (2,) the carrier's dead-reckoned way at that instant.

    The baselines that use this know of no features.
    """
    seen = [
        _Seen(carrier, boot, name, logs[name], *at_instant(logs[name], t_ns, settings))
        for name in sorted(logs)
    ]
    return Sightings(
        log=tuple(name for s in seen for name in s.log_ids()),
        source=tuple(s.source for s in seen for _ in s.which),
        fresh=tuple(f for s in seen for f in (s.logs.seq[s.which] == s.logs.report_seq).tolist()),
        identity=tuple(s.logs.identity[i] for s in seen for i in s.which),
        track=tuple(name for s in seen for name in s.tracks()),
        east_north_m=np.concatenate([np.zeros((0, 2)), *(s.place_m for s in seen)]) - way_m,
        covariance=np.concatenate([np.zeros((0, 2, 2)), *(s.covariance for s in seen)]),
        altitude_m=np.concatenate([np.zeros(0), *(s.logs.altitude_m[s.which] for s in seen)]),
        features=np.zeros((sum(len(s.which) for s in seen), 0)),
    )


class _Seen(NamedTuple):
    """The targets of one source at an instant."""

    carrier: str
    boot: int
    source: str
    logs: SourceLogs
    which: NDArray[np.intp]
    place_m: Array
    covariance: Array

    def log_ids(self) -> Iterator[str]:
        """Ids of their newest logs, as they are published."""
        stream = f"{self.carrier}/{self.boot}/{self.source}"
        seq, index = self.logs.seq[self.which], self.logs.index[self.which]
        return (f"{stream}/{s}/{i}" for s, i in zip(seq.tolist(), index.tolist(), strict=True))

    def tracks(self) -> Iterator[str]:
        """Their names as an operator's order has them; may be empty."""
        source = f"{self.carrier}/{self.source}/"
        names = (self.logs.track[i] for i in self.which)
        return (name and source + name for name in names)
