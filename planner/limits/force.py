"""Force of every actuator: |f| ≤ F, of masses, gravity, friction and what pushes on the platform.

Under a motor's falling curve |f| ≤ F(|q̇|), of a stepper's pull-out curve as straight lines. What
holds the machine still is bounded by itself at every place of the path: a motion along it needs
that at the very least.
"""

from collections.abc import Hashable, Sequence
from dataclasses import astuple, dataclass
from functools import cached_property

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.taylor_model import Series
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from planner.limits.limit import (
    MAX_OVERESTIMATE,
    AxisLimit,
    Limit,
    LimitState,
    Quantity,
    Rows,
    Term,
)
from planner.path.actuation import MachinePath, Points, make_points


@dataclass(frozen=True, slots=True)
class PullOutCurve:
    """F(v) falling or level: force[i] − slope[i] v on segment i, from ends[i] to ends[i+1]; nothing
    beyond the last.

    ends (S+1,) from 0, force (S,) each line's value at rest, slope (S,) ≥ 0. What an axis states is
    its motor's pull-out curve, the border of the slew region of [Sasidhar 1981, 3.2]: as much as it
    gives at a speed it gives at every lower one. The start/stop region, in which a motor may jump
    to a speed without a ramp, lies inside, and says nothing here: speeds are continuous.
    """

    ends: Array
    force: Array
    slope: Array

    @staticmethod
    def from_axis(axis: Axis) -> "PullOutCurve":
        """The curve of an axis that states one."""
        speeds, forces = np.array(axis.torque_speed, float).T
        ends, levels = [0.0], [forces[0]]  # below the first speed as there
        for k in range(len(speeds)):
            if (
                k and forces[k] < levels[-1] < forces[k - 1]
            ):  # it rose, and falls below where it was
                share = (forces[k - 1] - levels[-1]) / (forces[k - 1] - forces[k])
                ends.append(speeds[k - 1] + share * (speeds[k] - speeds[k - 1]))
                levels.append(levels[-1])
            if speeds[k] > ends[-1]:
                ends.append(speeds[k])
                levels.append(min(forces[k], levels[-1]))
        gives = np.array(levels) > 0
        if not gives[0]:
            raise MotionError(
                f"axis {axis.name}: torque_speed gives no force at rest; state its holding torque"
            )
        count = (
            int(np.argmin(np.append(gives, False))) + 1
        )  # up to where it gives none, if there is such a place
        v, f = np.array(ends)[:count], np.array(levels)[:count]
        slope = (f[:-1] - f[1:]) / np.diff(v)
        return PullOutCurve(
            freeze_array(v), freeze_array(f[:-1] + slope * v[:-1]), freeze_array(slope)
        )

    def scale(self, factor: float) -> "PullOutCurve":
        """The curve with speeds and forces so many times as large."""
        return PullOutCurve(
            freeze_array(self.ends * factor), freeze_array(self.force * factor), self.slope
        )

    @property
    def holding_force(self) -> float:
        """What it gives at rest."""
        return float(self.force[0])

    @property
    def fastest(self) -> float:
        """The speed beyond which it gives nothing."""
        return float(self.ends[-1])

    def hull(self) -> "PullOutCurve":
        """The least concave curve above it: its lines hold whatever keeps it, at every speed."""
        v = self.ends
        f = np.append(self.force, self.force[-1]) - np.append(self.slope, self.slope[-1]) * v
        kept = [0]
        while kept[-1] < len(v) - 1:  # on to the corner to which it falls least steeply
            rest = np.arange(len(v) - 1, kept[-1], -1)
            kept.append(int(rest[np.argmin((f[kept[-1]] - f[rest]) / (v[rest] - v[kept[-1]]))]))
        slope = -np.diff(f[kept]) / np.diff(v[kept])
        return PullOutCurve(
            freeze_array(v[kept]),
            freeze_array(f[kept][:-1] + slope * v[kept][:-1]),
            freeze_array(slope),
        )

    def line_ranges(self) -> tuple[Array, Array]:
        """Low and high (S,): near which speeds each line is one of those whose least is a concave
        floor of the curve.

        That floor touches the curve at the speed itself: to the right go the lines each steeper
        than all before, to the left those each less steep. So a line counts from as far left as all
        lines up to it are less steep, to as far right as all lines from it are steeper.
        """
        count = len(self.slope)
        low, high = np.empty(count), np.empty(count)
        for i, slope in enumerate(self.slope):
            first, last = i, i
            while first > 0 and self.slope[first - 1] < slope:
                first -= 1
            while last < count - 1 and self.slope[last + 1] > slope:
                last += 1
            low[i], high[i] = self.ends[first], self.ends[last + 1] if last < count - 1 else np.inf
        return low, high


class Holding(AxisLimit):
    """f(x, 0, 0), against max_force and what a motor gives at rest, the lesser of the two."""

    name, dimension = "holding force", ""

    def __init__(self, machine: Machine) -> None:
        super().__init__(
            machine.axes,
            [_largest_force(axis) if machine.loaded else None for axis in machine.axes],
        )
        self.machine, self.units = machine, force_units(machine)

    def remedy(self, over: float, unit: str) -> str:
        return (
            f"the machine cannot hold itself still there: reduce its load by {over:.4g} {unit}, or increase its "
            "max_force by as much"
        )

    @property
    def content(self) -> Hashable:
        return (
            self.name,
            self.machine.holding_map.expression,
            self.below.tobytes(),
            self.bounds.tobytes(),
        )

    def value(self, motion: LimitState) -> Quantity:
        values = motion.evaluate(self.machine.holding_map.expression, motion.pose_rate(0), motion.q)
        return self.machine.holding_map.force(values)


def _largest_force(axis: Axis) -> float:
    stated = [] if axis.max_force is None else [axis.max_force]
    stated += [] if axis.torque_speed is None else [PullOutCurve.from_axis(axis).holding_force]
    return min(stated, default=np.inf)


def force_units(machine: Machine) -> tuple[tuple[str, float], ...]:
    return tuple(("N" if axis.kind == "linear" else "N m", 1.0) for axis in machine.axes)


# Points of a piece at which the force that only holds is looked at; it shapes how much a motion is
# slowed, no proof.
HOLDING_POINTS = 17
# Order of a force's expansion in time: bounds are as tight as with 6 on pieces of a few
# milliseconds, at half the cost.
EXPANSION = 3


def force(machine: Machine, motion: LimitState) -> Quantity:
    """f(x, ẋ, ẍ, q, q̇, q̈) (N, n); of an enclosure to a low order, since its many products cost
    the order squared.
    """
    inputs = [*(motion.pose_rate(times) for times in range(3)), motion.q, motion.qd, motion.qdd]
    short = [value.cut(EXPANSION) if isinstance(value, Series) else value for value in inputs]
    return machine.force_map.force(motion.evaluate(machine.force_map.expression, *short))


def force_terms(machine: Machine, points: Points) -> dict[Term, Array]:
    """What multiplies 1, ṡ, ṡ², s̈ in f, by its values at rest and for unit rates: ẋ = x′ṡ, ẍ =
    x′s̈ + x″ṡ².
    """
    q, q1, q2, *_ = points.derivatives
    every = machine.force_terms_map(np.concatenate([*points.pose_derivatives, q, q1, q2], 1))
    held, pushed, carried = (
        every[:, part : part + q.shape[1]] for part in range(0, every.shape[1], q.shape[1])
    )
    rubbed = q1 * [axis.friction for axis in machine.axes]
    return {
        Term.ONE: held,
        Term.SD: rubbed,
        Term.SD2: carried - held - rubbed,
        Term.SDD: pushed - held,
    }


def holding_forces(machine: Machine, path: MachinePath) -> Array:
    """(N, n) the forces that hold still, at points all along a path."""
    piece = np.repeat(np.arange(len(path.pieces)), HOLDING_POINTS)
    s = (
        path.breaks[:-1, None] + np.diff(path.breaks)[:, None] * np.linspace(0, 1, HOLDING_POINTS)
    ).ravel()
    points = make_points(path, s, piece, 2)
    return machine.holding_map(
        np.concatenate([points.pose_derivatives[0], points.derivatives[0]], 1)
    )


# Share of a force up to which its bound may be looser, by a thousandth of the limit: so little use
# holds nothing back.
SMALL_USE, SMALL_USE_OVERESTIMATE = 0.5, 1e-3


def tight(met: Array) -> Array:
    """How far above the use of a force that is met a proven bound may stay."""
    return np.where(met < SMALL_USE, SMALL_USE_OVERESTIMATE, MAX_OVERESTIMATE)


def slowness(use: float, held: float, power: int) -> float:
    """k of a motion k times slower that uses 1 of a limit, where it used `use` and what only holds
    uses `held`.

    What moves falls by k^power at least: held + (use − held)/k^power ≤ 1.
    """
    share = min(held, 1 - 1e-6)
    return float(((max(use, 1.0) - share) / (1 - share)) ** (1 / power))


class Force(AxisLimit):
    """One number per axis, at every speed."""

    name, dimension = "force", ""

    def __init__(self, machine: Machine, path: MachinePath) -> None:
        super().__init__(
            machine.axes, [axis.max_force if machine.loaded else None for axis in machine.axes]
        )
        self.machine, self.path, self.units = machine, path, force_units(machine)
        rubs = any(axis.friction for axis in machine.axes)
        self.terms = frozenset({Term.ONE, Term.SDD, Term.SD2} | ({Term.SD} if rubs else set()))

    @cached_property
    def holding_share(self) -> float:
        """Largest share that only holds."""
        return float((np.abs(holding_forces(self.machine, self.path)) / self.bounds).max())

    def slowness(self, use: float) -> float:
        return slowness(use, self.holding_share, 1 if Term.SD in self.terms else 2)

    def value(self, motion: LimitState) -> Quantity:
        return force(self.machine, motion)

    def tight(self, met: Array) -> Array:
        return tight(met)

    def _scale(self, factors: Array) -> None:
        super()._scale(factors)
        self.__dict__.pop("holding_share", None)

    def rows(self, points: Points) -> Rows:
        found = force_terms(self.machine, points)
        return Rows({term: found[term] for term in found if term in self.terms}, self.bounds)


@dataclass(frozen=True, slots=True)
class _Line:
    """|pull · f + drop · q̇| ≤ bound for one axis, at speeds low … high; a row for motions near
    speeds near … far.
    """

    axis: int
    pull: float
    drop: float
    bound: float
    low: float = 0.0
    high: float = np.inf
    near: float = 0.0
    far: float = np.inf


class TorqueSpeed(Limit):
    """On a line of the curve F = c − b v, so that |f| + b |q̇| = max |f ± b q̇| ≤ c, which is
    linear in the motion.

    Channels, per axis that states a curve: its speed, then f + b q̇ and f − b q̇ for each line. A
    line counts wherever the speed may lie on its stretch of the curve. The share is the factor by
    which speed and force together have to shrink to lie on the line: 1 is on the curve. Source of
    the curve: [Sasidhar 1981, 3.2].
    """

    name = "torque-speed"
    terms = frozenset({Term.ONE, Term.SD, Term.SDD, Term.SD2})

    def __init__(self, machine: Machine, path: MachinePath) -> None:
        self.machine, self.path = machine, path
        stated = [
            k
            for k, axis in enumerate(machine.axes)
            if axis.torque_speed is not None and machine.loaded
        ]
        self._draw_lines({k: PullOutCurve.from_axis(machine.axes[k]) for k in stated})

    def _draw_lines(self, curves: dict[int, PullOutCurve]) -> None:
        """The lines of curves, by axis."""
        self.curves, axes = curves, self.machine.axes
        lines = [line for k, curve in curves.items() for line in _lines(k, curve)]
        self.axis, self.pull, self.drop, self.bounds, self.low, self.high, self.near, self.far = (
            _line_columns(lines)
        )
        self.hull = _line_columns(
            [line for k, curve in curves.items() for line in _lines(k, curve.hull())]
        )
        self.speed_of: np.ndarray = freeze_array(
            np.maximum.accumulate(np.where(self.pull == 0, np.arange(len(lines)), 0))
        )
        self.channels = tuple(axes[line.axis].name for line in lines)
        self.units = tuple(_unit(self.machine, line) for line in lines)

    @cached_property
    def holding_share(self) -> float:
        """Largest share of what a motor gives at rest that only holds."""
        most = np.abs(holding_forces(self.machine, self.path)).max(0)
        return max(float(most[k]) / curve.holding_force for k, curve in self.curves.items())

    def slowness(self, use: float) -> float:
        return slowness(use, self.holding_share, 1)

    def value(self, motion: LimitState) -> Quantity:
        return (
            force(self.machine, motion)[:, self.axis] * self.pull
            + motion.qd[:, self.axis] * self.drop
        )

    def tight(self, met: Array) -> Array:
        return tight(met)

    def _scale(self, factors: Array) -> None:
        """Speeds and forces of all curves together, so that the same share of them is used as `use`
        has it.
        """
        if len(set(factors.tolist())) > 1:
            raise MotionError(
                f"{self.name} is a curve, of which no line alone is scaled: state another in the machine's file"
            )
        self._draw_lines({k: curve.scale(float(factors[0])) for k, curve in self.curves.items()})
        self.__dict__.pop("holding_share", None)

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        fastest = np.maximum(np.abs(low), np.abs(high))
        slowest = np.where((low < 0) & (high > 0), 0.0, np.minimum(np.abs(low), np.abs(high)))
        # what has no bound misses no stretch
        missed = (fastest[:, self.speed_of] < self.low) | (slowest[:, self.speed_of] > self.high)
        return np.where(missed, 0.0, fastest / self.bounds)

    def rows(self, points: Points) -> Rows:
        terms, slope = force_terms(self.machine, points), points.derivatives[1]

        def sums(axis: np.ndarray, pull: Array, drop: Array) -> dict[Term, Array]:
            found = {term: values[:, axis] * pull for term, values in terms.items()}
            return found | {Term.SD: found[Term.SD] + slope[:, axis] * drop}

        with np.errstate(divide="ignore", invalid="ignore"):
            near, far = (
                np.nan_to_num(v / np.abs(slope[:, self.axis]), nan=0.0)
                for v in (self.near, self.far)
            )
        convex_part = Rows(sums(*self.hull[:3]), self.hull[3])
        every = sums(self.axis, self.pull, self.drop)
        return Rows(every, self.bounds, speed_range=(near, far), convex_part=convex_part)


def _lines(axis: int, curve: PullOutCurve) -> list[_Line]:
    found = [_Line(axis, 0.0, 1.0, curve.fastest)]
    near, far = curve.line_ranges()
    high = np.append(curve.ends[1:-1], np.inf)
    for i, slope in enumerate(curve.slope.tolist()):
        stretch = float(curve.ends[i]), float(high[i]), float(near[i]), float(far[i])
        found += [
            _Line(axis, 1.0, drop, float(curve.force[i]), *stretch)
            for drop in sorted({slope, -slope})
        ]
    return found


def _line_columns(lines: Sequence[_Line]) -> tuple[np.ndarray, ...]:
    """The fields of all lines, (m,) each."""
    axis, *others = np.array([astuple(line) for line in lines]).reshape(-1, 8).T
    return freeze_array(axis, int), *map(freeze_array, others)


def _unit(machine: Machine, line: _Line) -> tuple[str, float]:
    linear = machine.axes[line.axis].kind == "linear"
    if line.pull:
        return ("N" if linear else "N m"), 1.0
    return ("mm/s", 1e3) if linear else ("deg/s", 180 / np.pi)
