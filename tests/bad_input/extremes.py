"""Messages that are valid and mean: every number at some end of what the wire allows."""

from __future__ import annotations

import math
from random import Random
from typing import Any

import numpy as np

from schemas.messages import Navigation, Pose, SourceInfo, SourceProperties, SourceReport

SIGMAS = (1e-12, 5e-324, 1e-300, 0.005, 30.0, 1e6, 1e12)
ANGLES = (0.0, 6.28, -6.28, 1e-300, math.pi / 2, -math.pi / 2)
METRES = (0.0, 1e-300, -1.0, 1e9, -1e9, 2e4)
RANGES = (0.0, 1e-300, 1.0, 1e9, 5e7, 2e4)
VARIANCES = (1e-18, 1e-12, 1.0, 900.0, 1e10, 1e18)


class Mean:
    """Draws what one hostile carrier says at one instant."""

    def __init__(self, seed: int) -> None:
        self._dice = Random(seed)

    def navigation(self, **envelope: Any) -> Navigation:
        """A pose anywhere on the planet or off it."""
        pick = self._dice.choice
        covariance = pick((None, self._triangle(3), self._triangle(6)))
        pose = Pose(
            latitude_rad=pick((0.7, 0.7, math.pi / 2, -math.pi / 2, 0.0)),
            longitude_rad=pick((0.5, 0.5, 6.28, -math.pi)),
            altitude_m=pick((0.0, 20.0, 1e9, -1e9, -6378137.0)),
            heading_rad=pick(ANGLES),
            covariance=covariance,
        )
        return Navigation(
            pose=pose,
            reckoned_east_m=pick(METRES),
            reckoned_north_m=pick(METRES),
            speed_mps=pick((0.0, 1e5, -1e5)),
            sigma_speed_mps=pick((None, *SIGMAS)),
            sigma_heading_rad=pick((None, *SIGMAS)),
            stream="navigation",
            **envelope,
        )

    def info(self, **envelope: Any) -> SourceInfo:
        """Sigmas of any size, or none."""
        pick = self._dice.choice
        properties = SourceProperties(
            coordinates=pick(("bearing_range", "bearing", "geodetic")),
            sigma_bearing_rad=pick((None, *SIGMAS)),
            sigma_range_m=pick((None, *SIGMAS)),
            sigma_position_m=pick((None, *SIGMAS)),
        )
        return SourceInfo(source="radar", properties=properties, stream="info", **envelope)

    def report(self, **envelope: Any) -> SourceReport:
        """Logs in all coordinates at once, some cells absent."""
        pick, n = self._dice.choice, self._dice.choice((0, 1, 2, 5, 12))
        columns: dict[str, Any] = {
            "bearing_rad": self._column(n, ANGLES),
            "range_m": self._column(n, RANGES),
            "elevation_rad": self._column(n, ANGLES),
            "east_m": self._column(n, METRES),
            "north_m": self._column(n, METRES),
            "up_m": self._column(n, METRES),
            "latitude_rad": self._column(n, (0.7, math.pi / 2, -math.pi / 2)),
            "longitude_rad": self._column(n, (0.5, 6.28, -6.28)),
            "altitude_m": self._column(n, METRES),
            "time_offset_s": self._column(n, (0.0, 1e6, -1e6, 1e-9)),
            "sigma_bearing_rad": self._column(n, SIGMAS),
            "sigma_range_m": self._column(n, SIGMAS),
            "sigma_elevation_rad": self._column(n, SIGMAS),
            "sigma_position_m": self._column(n, SIGMAS),
            "sigma_time_offset_s": self._column(n, SIGMAS),
            "covariance_polar": [pick((None, self._triangle(2), self._triangle(3)))] * n,
            "covariance_position": [pick((None, self._triangle(2), self._triangle(3)))] * n,
        }
        sent = {name: column for name, column in columns.items() if self._dice.random() < 0.6 and n}
        names = [f"t{self._dice.randrange(12)}" for _ in range(n)]
        named = {"identity": names, "identity_kind": ["x"] * n} if n else {}
        return SourceReport(stream="radar", **sent, **named, **envelope)

    def _column(self, n: int, values: tuple[float, ...]) -> list[float | None]:
        return [None if self._dice.random() < 0.2 else self._dice.choice(values) for _ in range(n)]

    def _triangle(self, order: int) -> list[float]:
        """The upper triangle of a positive definite matrix, hardly so."""
        sigmas = np.sqrt([self._dice.choice(VARIANCES) for _ in range(order)])
        matrix = np.outer(sigmas, sigmas) * 0.3 + np.diag(sigmas**2) * 0.7
        triangle: list[float] = matrix[np.triu_indices(order)].tolist()
        return triangle
