"""ISO-style circular test: how round a circle gets, and how large, in both directions."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array, unit_vectors
from kinematics.foundation.errors import MotionError
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table

ANGLE_COUNT = 720
"""Of a full turn, even: two a degree."""
MAX_TURN_SHORTFALL = np.deg2rad(1.0)
"""By which an axis with play may end before its full turn."""


@dataclass(frozen=True, slots=True)
class Circle:
    """The programmed circle: centre (3,), m, unit normal (3,), radius m, feed m/s."""

    centre: Array
    normal: Array
    radius: float
    feed: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", freeze_array(self.centre, np.float64))
        object.__setattr__(
            self, "normal", freeze_array(unit_vectors(self.normal, "circle: normal", (3,)))
        )
        if not 0 < self.radius < float("inf"):
            raise MotionError(f"circular test: radius {self.radius} m must be above 0")


@dataclass(frozen=True, slots=True)
class Roundness:
    """One direction of a circular test.

    angle, deviation  (N,) rad and m: where about the programmed centre, and r − R there
    centre    (2,) m, of the least-squares circle, from the programmed one, along the plane's axes
    radius    ρ of the least-squares circle, m
    circular  G = max r − min r about its centre, m
    """

    angle: Array = field(repr=False)
    deviation: Array = field(repr=False)
    centre: Array
    radius: float
    circular: float

    @property
    def radial_max(self) -> float:
        """F_max: largest r − R about the programmed centre, m."""
        return float(self.deviation.max())

    @property
    def radial_min(self) -> float:
        """F_min, the smallest."""
        return float(self.deviation.min())


@dataclass(frozen=True, slots=True)
class CircularTest(Result):
    """A full turn in each direction, in the style of ISO 230-4; a simulation certifies nothing.

    ccw, cw   counter-clockwise and clockwise, seen against the normal
    both      G(b) = max r − min r of both about their one least-squares centre, m
    """

    circle: Circle
    ccw: Roundness
    cw: Roundness
    both: float

    @property
    def mean_radial(self) -> float:
        """D = (ρ_ccw + ρ_cw)/2 − R, m: the mean bidirectional radial deviation."""
        return (self.ccw.radius + self.cw.radius) / 2 - self.circle.radius

    def figures(self) -> dict[str, float]:
        """All in m."""
        return {
            "circular_ccw": self.ccw.circular,
            "circular_cw": self.cw.circular,
            "circular_both": self.both,
            "radial_max_ccw": self.ccw.radial_max,
            "radial_min_ccw": self.ccw.radial_min,
            "radial_max_cw": self.cw.radial_max,
            "radial_min_cw": self.cw.radial_min,
            "mean_radial": self.mean_radial,
        }

    def tables(self) -> tuple[Table, ...]:
        """Every figure."""
        about = f"ISO-style, diameter {2e3 * self.circle.radius:.6g} mm at {1e3 * self.circle.feed:.6g} mm/s"
        figures = self.figures()
        columns = (
            Column("figure", [*figures]),
            Column("value", [*figures.values()], "m", "micro", ".3f"),
        )
        return (Table(f"{about}, least-squares centres", columns),)

    def data(self) -> Table:
        """The radial deviation of both turns over the angle."""
        turns = {"ccw": self.ccw, "cw": self.cw}
        columns = (
            Column("turn", [name for name, turn in turns.items() for _ in turn.angle]),
            Column("angle", np.concatenate([turn.angle for turn in turns.values()]), "rad"),
            Column("deviation", np.concatenate([turn.deviation for turn in turns.values()]), "m"),
        )
        return Table("ISO-style circular test: deviation from the programmed radius", columns)


def full_turn(points: Array, circle: Circle, sense: int) -> Array:
    """A record's (N, 3) first full turn from where it starts, at 720 even angles: (720, 2) in the
    plane of the circle.

    So neither ramps nor rests count for more than the rest of the way. Linear in polar coordinates
    between samples; sense 1 counter-clockwise, −1 clockwise, seen against the normal.

    Raises MotionError for a record that ends more than `MAX_TURN_SHORTFALL` before the full turn.
    """
    flat = (points - circle.centre) @ _plane(circle.normal).T
    angle = np.unwrap(np.arctan2(flat[:, 1], flat[:, 0]))
    forward = np.maximum.accumulate(sense * (angle - angle[0]))
    if forward[-1] < 2 * np.pi - MAX_TURN_SHORTFALL:
        way = "counter-clockwise" if sense > 0 else "clockwise"
        raise MotionError(
            f"circular test: the {way} record turns by {np.rad2deg(forward[-1]):.4g}° about the centre; give a full "
            f"turn of the circle of {circle.radius * 1e3:.6g} mm, 360°"
        )
    first = np.concatenate([[True], np.diff(forward) > 0])
    wanted = 2 * np.pi / ANGLE_COUNT * np.arange(ANGLE_COUNT)
    wanted = wanted[wanted <= forward[-1]]
    radius = np.interp(wanted, forward[first], np.linalg.norm(flat, axis=1)[first])
    at = angle[0] + sense * wanted
    return np.asarray(radius[:, None] * np.stack([np.cos(at), np.sin(at)], 1))


def circular_test(ccw: Array, cw: Array, circle: Circle) -> CircularTest:
    """From records of points (N, 3) that go round each way, m; of each its first full turn, see
    `full_turn`.

    Least-squares circle: min over c, ρ of Σ (‖p − c‖ − ρ)².

    Raises MotionError for a record that does not go all the way round.
    """
    there, back = full_turn(ccw, circle, 1), full_turn(cw, circle, -1)
    every = np.concatenate([there, back])
    centre, _ = _least_squares(every, circle.radius)
    both = float(np.ptp(np.linalg.norm(every - centre, axis=1)))
    return CircularTest(
        circle, _roundness(there, circle.radius), _roundness(back, circle.radius), both
    )


def _roundness(points: Array, radius: float) -> Roundness:
    centre, fitted = _least_squares(points, radius)
    return Roundness(
        freeze_array(np.arctan2(points[:, 1], points[:, 0])),
        freeze_array(np.linalg.norm(points, axis=1) - radius),
        freeze_array(centre),
        fitted,
        float(np.ptp(np.linalg.norm(points - centre, axis=1))),
    )


def _least_squares(points: Array, radius: float) -> tuple[Array, float]:
    """Centre (2,) and radius of the circle nearest to points (N, 2); solved in units of the
    programmed radius.
    """
    from scipy.optimize import least_squares

    scaled = points / radius

    def misfit(x: Array) -> Array:
        return np.asarray(np.linalg.norm(scaled - x[:2], axis=1) - x[2])

    def slope(x: Array) -> Array:
        away = scaled - x[:2]
        unit = -away / np.linalg.norm(away, axis=1)[:, None]
        return np.column_stack([unit, -np.ones(len(unit))])

    found = least_squares(
        misfit, [0.0, 0.0, 1.0], jac=slope, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    return radius * found.x[:2], float(radius * found.x[2])


def _plane(normal: Array) -> Array:
    """Two unit vectors (2, 3) across the normal, that turn counter-clockwise seen against it."""
    first = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])
