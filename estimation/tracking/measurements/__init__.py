"""What plots say about tracks: predicted values, gradients and noise, by kind of measurement.

All kinds give the same thing, rows: one scalar equation each for pairs of a track and a plot.
East and north are of the picture, bearings clockwise from its north. A kind is a `Measurement`;
`polar`, `bearings` and `places` make them.
"""

from estimation.tracking.measurements.bearing import Bearings, bearings
from estimation.tracking.measurements.kinds import Found, Measurement, Probe, Row
from estimation.tracking.measurements.line_of_sight import longest_axis
from estimation.tracking.measurements.place import Places, places
from estimation.tracking.measurements.polar import Polar, RangeRate, polar

__all__ = [
    "Bearings",
    "Found",
    "Measurement",
    "Places",
    "Polar",
    "Probe",
    "RangeRate",
    "Row",
    "bearings",
    "longest_axis",
    "places",
    "polar",
]
