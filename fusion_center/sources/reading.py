"""The logs of a report as columns: names, instants, places; what cannot be used is marked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from schemas.messages import SourceReport

from ..navigation import NS
from ..settings import LogSettings
from .coordinates import Places, instants_ns
from .tracks import Plots


class Fresh(NamedTuple):
    """The logs of a report in the terms of `SourceLogs`; `born` with the nameless among them."""

    seq: int
    stamp_ns: int
    key: list[str]
    identity: list[str]
    track: list[str]
    is_increment: NDArray[np.bool_]
    astray: NDArray[np.bool_]
    usable: NDArray[np.bool_]
    t_ns: NDArray[np.int64]
    place_m: Array
    covariance: Array
    altitude_m: Array
    born: int = 0

    @property
    def plots(self) -> Plots:
        """All of them as plots."""
        return Plots(self.t_ns, self.place_m, self.covariance)


def read(report: SourceReport, places: Places, way_m: Array, settings: LogSettings) -> Fresh:
    """Names, instants and places of a report's logs; an unsure instant makes the place unsure."""
    n = len(report)
    identity, track = _identities(report, n), _texts(report.track_id, n)
    key = [f"i/{i}" if i else f"t/{t}" if t else "" for i, t in zip(identity, track, strict=True)]
    kinds = _texts(report.kind, n)
    covariance = places.covariance
    if report.sigma_time_offset_s is not None:
        sigma_s = np.nan_to_num(np.array(report.sigma_time_offset_s, dtype=np.float64))
        covariance = covariance + round_covariance((settings.sigma_velocity_mps * sigma_s) ** 2)
    t_ns = instants_ns(report)
    astray = np.abs(t_ns - report.t_ns) * NS > settings.max_age_s
    return Fresh(
        seq=report.seq,
        stamp_ns=report.t_ns,
        key=key,
        identity=identity,
        track=track,
        is_increment=np.array([kind == "increment" for kind in kinds], dtype=np.bool_),
        astray=astray,
        usable=places.usable & ~astray,
        t_ns=t_ns,
        place_m=places.east_north_m + way_m,
        covariance=covariance,
        altitude_m=places.altitude_m,
    )


def _identities(report: SourceReport, n: int) -> list[str]:
    names, kinds = _texts(report.identity, n), _texts(report.identity_kind, n)
    return [f"{kind}/{name}" if name else "" for name, kind in zip(names, kinds, strict=True)]


def _texts(values: Sequence[str | None] | None, n: int) -> list[str]:
    return [""] * n if values is None else [value or "" for value in values]


def round_covariance(variance: Array) -> Array:
    """Covariances (n, 2, 2) of equal variance (n,) [m^2] in every direction."""
    return variance[:, None, None] * np.eye(2)
