"""The logs of one report as columns of arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array


class Logs(NamedTuple):
    """L target logs as columns; None = the sensor does not measure that.

    Attributes:
        classes: reported class and how likely it is the right one.
        features: name -> values, NaN where a log has none; words: the same, None.
    """

    bearing_rad: Array
    range_m: Array | None
    elevation_rad: Array | None
    time_offset_s: Array | None
    identity: np.ndarray | None
    classes: np.ndarray | None
    features: dict[str, Array]
    words: dict[str, np.ndarray]

    def take(self, rows: np.ndarray) -> Logs:
        """The same of some rows."""
        return self._replace(
            bearing_rad=self.bearing_rad[rows],
            range_m=_taken(self.range_m, rows),
            elevation_rad=_taken(self.elevation_rad, rows),
            time_offset_s=_taken(self.time_offset_s, rows),
            identity=_taken(self.identity, rows),
            classes=_taken(self.classes, rows),
            features={name: values[rows] for name, values in self.features.items()},
            words={name: values[rows] for name, values in self.words.items()},
        )

    def join(self, other: Logs) -> Logs:
        """These and then those of the same sensor."""
        return Logs(
            bearing_rad=np.concatenate([self.bearing_rad, other.bearing_rad]),
            range_m=_joined(self.range_m, other.range_m),
            elevation_rad=_joined(self.elevation_rad, other.elevation_rad),
            time_offset_s=_joined(self.time_offset_s, other.time_offset_s),
            identity=_joined(self.identity, other.identity),
            classes=_joined(self.classes, other.classes),
            features={
                name: np.concatenate([values, other.features[name]])
                for name, values in self.features.items()
            },
            words={
                name: np.concatenate([values, other.words[name]])
                for name, values in self.words.items()
            },
        )


def _taken(column: np.ndarray | None, rows: np.ndarray) -> np.ndarray | None:
    return None if column is None else column[rows]


def _joined(a: np.ndarray | None, b: np.ndarray | None) -> np.ndarray | None:
    return None if a is None or b is None else np.concatenate([a, b])
