"""How a target may move: place = c0 + c1 f(t; shape), or a polynomial with more coefficients.

Planes are complex numbers, east + i north. All motions are linear in their coefficients c, so a
closed form finds these; only the few numbers of `shape` (a turn's angle, middle and duration, a
turn rate, an acceleration along the course) must be searched. Times are in half spans of the
observation from its middle, as `Scene.time`. Turns to the right are positive.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from math import factorial
from typing import NamedTuple, TypeAlias

import numpy as np

from estimation.arrays import Array
from estimation.bearings_only.measurements import ComplexArray

Path: TypeAlias = Callable[[Array, Array], tuple[ComplexArray, ComplexArray]]

_SMALL = 1e-3  # below it a power series is more exact than the formula


class Motion(NamedTuple):
    """A kind of motion.

    Attributes:
        name: as reported.
        degree: of the polynomial in time, or in `path`.
        shape_names: of its P shape parameters: kappa (acceleration by speed), omega, angle,
            middle, duration (logarithm); all in half spans and radians.
        path: (time (N, B), shape (P, B)) -> f (N, B) and its derivatives (P, N, B); None: time.
        grid: (P, G) shapes to begin a search with.
        knots: instants at which the acceleration of a spline jumps; only without `path`.
        odds: how likely before the first bearing, by the odds of any other motion. Half of all
            targets hold course and speed; a turn is one kind in two forms; hardly any has a jerk.
        like: the motion that this one is another form of; their weights count together.
    """

    name: str
    degree: int
    shape_names: tuple[str, ...] = ()
    path: Path | None = None
    grid: tuple[tuple[float, ...], ...] = ((),)
    knots: tuple[float, ...] = ()
    odds: float = 1.0
    like: str = ""

    @property
    def kind(self) -> str:
        """The motion and all its forms."""
        return self.like or self.name

    @property
    def size(self) -> int:
        """Parameters (real), homogeneous scale included."""
        return 2 * self.degree + 3 + len(self.shape_names)

    @property
    def scale_row(self) -> int:
        """Where the homogeneous scale s stands among the parameters."""
        return 2 * self.degree + 2

    def basis(self, time: Array, shape: Array) -> tuple[ComplexArray, ComplexArray]:
        """f_j (K, N, B) and the derivatives of f_1 by the shape (P, N, B).

        For polynomials f_j = t^j / j!, so that c_j is the j-th derivative in the middle.
        """
        if self.path is None:
            powers = range(self.degree + 1 - len(self.knots))
            f = np.stack(
                [time**j / factorial(j) for j in powers]
                + [np.maximum(time - knot, 0.0) ** 2 / 2 for knot in self.knots]
            )
            return f.astype(complex), np.zeros((0, *time.shape), dtype=complex)
        along, derivatives = self.path(time, shape)
        return np.stack([np.ones_like(along), along]), derivatives


def straight_path(time: Array, shape: Array) -> tuple[ComplexArray, ComplexArray]:
    """Acceleration along the course: f = t + kappa t^2 / 2."""
    half_square = time**2 / 2 + np.zeros_like(shape[0])
    return (time + shape[0] * half_square).astype(complex), half_square[None].astype(complex)


def circular_path(time: Array, shape: Array) -> tuple[ComplexArray, ComplexArray]:
    """Constant turn rate: f = integral of exp(-i omega t)."""
    angle = -1j * shape[0] * time
    e1, de1, _ = _exponential_mean(angle)
    return time * e1, (time * de1 * -1j * time)[None]


def turning_path(time: Array, shape: Array) -> tuple[ComplexArray, ComplexArray]:
    """Constant speed, one or more turns; shape = (angle, middle, log duration) of each.

    Each turn is a circular arc. Turn after turn: f = f1 + exp(-i angle1) (f2 - t), exact when the
    first has ended before the second begins.
    """
    f, slopes = _one_turn(time, shape[:3])
    turned = np.exp(-1j * shape[0])
    for k in range(3, len(shape), 3):
        later, later_slopes = _one_turn(time, shape[k : k + 3])
        f = f + turned * (later - time)
        earlier = [
            slopes[j] - 1j * turned * (later - time) if j % 3 == 0 else slopes[j] for j in range(k)
        ]
        slopes = np.stack([*earlier, *(turned * later_slopes)])
        turned = turned * np.exp(-1j * shape[k])
    return f, slopes


def legs_path(time: Array, shape: Array) -> tuple[ComplexArray, ComplexArray]:
    """Constant speed, one turn in no time; shape = (angle, middle)."""
    angle, middle = shape
    turned = np.cos(angle) - 1j * np.sin(angle)
    after = np.maximum(time - middle, 0.0)
    slopes = np.empty((2, *after.shape), dtype=complex)
    slopes[0] = -1j * turned * after
    slopes[1] = np.where(after > 0, 1 - turned, 0.0)
    return np.minimum(time, middle) + turned * after, slopes


def _one_turn(time: Array, shape: Array) -> tuple[ComplexArray, ComplexArray]:
    """Path f = t before the turn, a circular arc, then a straight line; shape (3, B).

    With g = f - middle and x = t - middle, a later turn shifts g (derivative 1 - f'), a longer
    one scales it about the middle (g - x f').
    """
    angle, middle, duration = shape[0], shape[1], np.exp(shape[2])
    x = time - middle
    u = np.clip(x / duration + 0.5, 0.0, 1.0)
    e1, de1, direction = _exponential_mean(-1j * angle * u)
    after = np.maximum(x - duration / 2, 0.0)
    turned = np.exp(-1j * angle)
    g = np.minimum(x, -duration / 2) + duration * u * e1 + turned * after
    by_angle = -1j * (duration * u**2 * de1 + turned * after)
    return middle + g, np.stack([by_angle, 1 - direction, g - x * direction])


def _exponential_mean(z: ComplexArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """(exp(z) - 1) / z, its derivative, and exp(z), of imaginary z."""
    angle = z.imag
    e = np.cos(angle) + 1j * np.sin(angle)
    small = np.abs(angle) < _SMALL
    by = 1 / np.where(small, 1j, z)
    mean = (e - 1) * by
    slope = (e - mean) * by
    if small.any():
        mean = np.where(small, 1 + z / 2 + z**2 / 6, mean)
        slope = np.where(small, 0.5 + z / 3 + z**2 / 8, slope)
    return mean, slope, e


def polynomial(degree: int) -> Motion:
    """A polynomial of time: 1 constant velocity, 2 constant acceleration, 3 constant jerk."""
    names = {1: "constant velocity", 2: "constant acceleration", 3: "constant jerk"}
    name = names.get(degree, f"polynomial of degree {degree}")
    return Motion(name, degree, odds={1: 6.0, 3: 1 / 3}.get(degree, 1.0))


def spline(pieces: int) -> Motion:
    """Constant acceleration in each of some equal parts of the observation, as smooth as that is.

    It says nothing of how a target moves but that it has inertia, so it fits turns of any kind.
    """
    knots = tuple(2 * (k + 1) / pieces - 1 for k in range(pieces - 1))
    return Motion(f"{pieces} accelerations", 1 + pieces, knots=knots)


def _grid(*axes: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
    return tuple(zip(*product(*axes), strict=True))


def _two_turns() -> tuple[tuple[float, ...], ...]:
    angles, middles = (-1.7, -0.7, 0.7, 1.7), (-0.7, -0.35, 0.0, 0.35, 0.7)
    shapes = [
        (a, m, -1.9, b, n, -1.9)
        for a, b in product(angles, angles)
        for m, n in product(middles, middles)
        if m < n
    ]
    return tuple(zip(*shapes, strict=True))


_ANGLES = (-2.4, -1.6, -1.0, -0.4, 0.4, 1.0, 1.6, 2.4)
_MIDDLES = (-0.85, -0.6, -0.35, -0.1, 0.15, 0.4, 0.65, 0.85)

CONSTANT_VELOCITY = polynomial(1)
CONSTANT_ACCELERATION = polynomial(2)
CONSTANT_JERK = polynomial(3)
STRAIGHT_ACCELERATED = Motion(
    "straight accelerated",
    1,
    ("kappa",),
    straight_path,
    _grid((-6, -2.5, -1.2, -0.6, -0.2, 0.2, 0.6, 1.2, 2.5, 6)),
)
TURN_RATE = Motion(
    "turn rate",
    1,
    ("omega",),
    circular_path,
    _grid((-7, -4.7, -3, -1.6, -0.8, -0.3, 0.3, 0.8, 1.6, 3, 4.7, 7)),
)
_ONE = ("angle", "middle", "duration")
FINITE_TURN = Motion(
    "finite turn", 1, _ONE, turning_path, _grid(_ANGLES, _MIDDLES, (-1.3,)), odds=0.5
)
TWO_LEGS = Motion(
    "two legs",
    1,
    ("angle", "middle"),
    legs_path,
    _grid(_ANGLES, _MIDDLES),
    odds=0.5,
    like=FINITE_TURN.name,
)
THREE_LEGS = Motion("three legs", 1, _ONE + _ONE, turning_path, _two_turns())

FAMILY = (
    CONSTANT_VELOCITY,
    CONSTANT_ACCELERATION,
    CONSTANT_JERK,
    STRAIGHT_ACCELERATED,
    TURN_RATE,
    TWO_LEGS,
    FINITE_TURN,
)
"""What a target is tried as; `THREE_LEGS` comes in on alarm."""
