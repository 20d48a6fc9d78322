"""Survey beacons from a real vehicle's ranges and odometry alone, then look at the truth.

    python examples/range_and_odometry.py FILE

FILE is one of the "Plaza" sets (Djugash, Hamner & Roth 2009, as GTSAM ships them): `DR` [time,
distance, turn] of the odometry, `TD` [time, from, to, range], `TL` [beacon, x, y] as surveyed and
`GT` [time, x, y, heading] by GPS. Only `DR` and `TD` are used to estimate; the first pose fixes
the axes. The radio's ranges read long by a factor that nobody knew, which is estimated too.
"""

from __future__ import annotations

import argparse
import gzip
import io
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.io import loadmat

from estimation.arrays import Array
from estimation.consistency import nees, rms
from estimation.system_alignment import (
    Alignment,
    DeadReckoning,
    Ranges,
    align,
    closed_form_start,
    dead_reckoning,
    places_of,
    prior,
    ranges,
)

SIGMA_RANGE_M, SIGMA_OFFSET_M = 0.6, 0.5  # beacons are not all alike
SIGMA_SLIP_MPS_ROOT_S, SIGMA_ASIDE_RAD_ROOT_S = 0.03, 0.07  # wheels slip, the body crabs in turns
SIGMA_GYRO_RAD_ROOT_S, SIGMA_MOUNTING_RAD, SIGMA_WHEEL_SCALE = 0.0005, 0.03, 0.005
SIGMA_BEACON_M, SIGMA_RANGE_SCALE = 300.0, 0.1  # next to nothing is known

_COLUMNS = {
    "DR": ("time", "distance", "turn"),
    "TD": ("time", "from", "to", "range"),
    "TL": ("beacon", "x", "y"),
    "GT": ("time", "x", "y", "heading"),
}
_IN_ORDER = ("DR", "GT")


class Drive(NamedTuple):
    """What was recorded.

    Attributes:
        path: dead reckoning, one epoch for every range.
        logs: the ranges; beacons numbered in the order of `surveyed_m`.
        surveyed_m: (J, 2) beacons, for comparison; not a number where one was only heard.
        truth_m: (n, 2) places by GPS at the epochs, for comparison.
    """

    path: DeadReckoning
    logs: Ranges
    surveyed_m: Array
    truth_m: Array


class Comparison(NamedTuple):
    """An alignment beside the survey and GPS.

    Attributes:
        beacon_errors_m: (J,) distances.
        path_rmse_m: of the places; `reckoned_rmse_m` of dead reckoning alone.
        nees: of the beacons' coordinates, by dimension.
    """

    beacon_errors_m: Array
    path_rmse_m: float
    reckoned_rmse_m: float
    nees: float


def read(path: Path) -> Drive:
    """A drive from a `.mat` file, gzipped or not.

    Raises:
        ValueError: it cannot be read, or a table is missing, too narrow, empty or out of order.
    """
    try:
        raw = path.read_bytes()
        tables = loadmat(io.BytesIO(gzip.decompress(raw) if path.suffix == ".gz" else raw))
    except Exception as reason:  # whatever scipy makes of bytes that are no such file
        raise ValueError(f"{path}: cannot be read as a .mat file: {reason}") from reason
    odometry, measured, surveyed, truth = (
        _table(path, tables, name, columns) for name, columns in _COLUMNS.items()
    )
    time = np.unique(measured[:, 0])
    heard = np.setdiff1d(measured[:, 2], surveyed[:, 0])
    numbers = {name: number for number, name in enumerate([*surveyed[:, 0], *heard])}
    known = np.vstack([surveyed[:, 1:3], np.full((len(heard), 2), np.nan)])
    logs = ranges(
        np.searchsorted(time, measured[:, 0]),
        [numbers[beacon] for beacon in measured[:, 2]],
        measured[:, 3],
        SIGMA_RANGE_M,
    )
    places = np.column_stack([np.interp(time, truth[:, 0], truth[:, i]) for i in (1, 2)])
    return Drive(_reckoned(odometry, truth[0], time), logs, known, places)


def _table(path: Path, tables: dict[str, Any], name: str, columns: tuple[str, ...]) -> Array:
    """One table, its columns checked."""
    form = f"{path}: needs a table {name} with columns {', '.join(columns)}"
    if name not in tables:
        raise ValueError(f"{form}: it is not there")
    table = np.asarray(tables[name])
    if table.ndim != 2 or table.shape[1] < len(columns) or table.dtype.kind not in "iuf":
        raise ValueError(f"{form}: got shape {table.shape} of {table.dtype}")
    table = table.astype(float)
    if not len(table) or not np.isfinite(table[:, : len(columns)]).all():
        raise ValueError(f"{form}: it is empty, or has values that are no numbers")
    if name in _IN_ORDER and np.any(np.diff(table[:, 0]) < 0):
        raise ValueError(f"{form}: times must not go back")
    return table


def _reckoned(odometry: Array, first: Array, time: Array) -> DeadReckoning:
    """Dead reckoning between given instants from wheel distances and turns (anticlockwise)."""
    turned = first[3] + np.cumsum(odometry[:, 2]) - odometry[:, 2] / 2
    steps = odometry[:, 1, None] * np.column_stack([np.cos(turned), np.sin(turned)])
    instants = np.concatenate([first[:1], odometry[:, 0]])
    whole = np.vstack([first[1:3], first[1:3] + np.cumsum(steps, axis=0)])
    at = np.column_stack([np.interp(time, instants, whole[:, i]) for i in (0, 1)])
    travel = np.diff(np.vstack([first[1:3], at]), axis=0)
    interval = np.maximum(np.diff(np.concatenate([first[:1], time])), 1e-3)
    return dead_reckoning(
        interval,
        np.hypot(*travel.T) / interval,
        np.arctan2(*travel.T),
        SIGMA_SLIP_MPS_ROOT_S / np.sqrt(interval),
        SIGMA_ASIDE_RAD_ROOT_S / np.sqrt(interval),
        sigma_turn_rad=SIGMA_GYRO_RAD_ROOT_S * np.sqrt(interval),
        start_m=first[1:3],
    )


def survey(drive: Drive) -> Alignment:
    """Beacons, range scale and path, with no prior place of any beacon."""
    count = len(drive.surveyed_m)
    known = prior(
        np.zeros((count, 3)),
        [SIGMA_BEACON_M, SIGMA_BEACON_M, 0.0],  # all in one plane
        sigma_offset_m=SIGMA_OFFSET_M,
        sigma_range_scale=SIGMA_RANGE_SCALE,
        sigma_heading_bias_rad=SIGMA_MOUNTING_RAD,
        sigma_speed_scale=SIGMA_WHEEL_SCALE,
    )
    start = closed_form_start(drive.path, drive.logs, known)
    return align(drive.path, drive.logs, known, start=start)


def compared(found: Alignment, drive: Drive) -> Comparison:
    """Errors against the survey and GPS, in the axes of the first pose."""
    every = found.beacons_m[:, :2] - drive.surveyed_m
    known = np.isfinite(every[:, 0])
    error = every[known]
    where = places_of(found.theta)[known, :2].ravel()
    return Comparison(
        np.hypot(*every.T),
        float(rms(np.hypot(*(found.path_m - drive.truth_m).T))),
        float(rms(np.hypot(*(drive.path.path_m - drive.truth_m).T))),
        float(nees(error.ravel(), found.covariance[np.ix_(where, where)])) / len(where),
    )


def main() -> None:
    """Survey and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", type=Path, help="a .mat file of the Plaza sets, may be gzipped")
    try:
        drive = read(parser.parse_args().file)
    except ValueError as reason:
        sys.exit(str(reason))
    found = survey(drive)
    told = compared(found, drive)
    sigma = np.sqrt(np.diag(found.covariance))
    print(f"{len(drive.logs.value_m)} ranges, {found.status}")
    for number, (place, off) in enumerate(zip(found.beacons_m, told.beacon_errors_m, strict=True)):
        print(f"beacon {number + 1}: {place[0]:7.2f} {place[1]:7.2f} m, {off:.2f} m off the survey")
    print(f"ranges read long: {100 * found.theta[4]:.2f} +- {100 * sigma[4]:.2f} %")
    print(
        f"path: {told.path_rmse_m:.2f} m off GPS; dead reckoning alone {told.reckoned_rmse_m:.2f} m"
    )
    print(f"ranges in full use: {100 * found.weights.mean():.1f} %, NEES {told.nees:.2f}")
    for direction in found.undetermined:
        print(f"not told by the ranges: {direction.name}")


if __name__ == "__main__":
    main()
