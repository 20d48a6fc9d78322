"""What plots say about tracks: predicted values, gradients and noise, by kind of measurement.

All kinds give the same two things: the readings of the plots, and what a target should give.
East and north are of the picture, bearings clockwise from its north. A kind is a `Measurement`;
`polar`, `bearings` and `places` make them.
"""

from estimation.tracking.measurements.bearing import Bearings, bearings
from estimation.tracking.measurements.kinds import (
    PLACE_ROWS,
    Expected,
    Found,
    Measurement,
    Readings,
)
from estimation.tracking.measurements.place import Places, places
from estimation.tracking.measurements.polar import Polar, RangeRate, polar

__all__ = [
    "PLACE_ROWS",
    "Bearings",
    "Expected",
    "Found",
    "Measurement",
    "Places",
    "Polar",
    "RangeRate",
    "Readings",
    "bearings",
    "places",
    "polar",
]
