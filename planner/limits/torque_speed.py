"""Force of every actuator within its motor's falling curve: |f| ≤ F(|q̇|)."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from functools import cached_property

import numpy as np

from kinematics.array import Array, frozen
from kinematics.machine import Machine
from planner.actuation import MachinePath, Points
from planner.limits.force import force, force_terms, held, slowness
from planner.limits.limit import Limit, Motion, Quantity, Rows, Term
from planner.limits.pull_out import Curve


@dataclass(frozen=True, slots=True)
class _Line:
    """|pull · f + drop · q̇| ≤ bound for one axis, at speeds low … high; a row for motions near speeds near … far."""

    axis: int
    pull: float
    drop: float
    bound: float
    low: float = 0.0
    high: float = np.inf
    near: float = 0.0
    far: float = np.inf


class TorqueSpeed(Limit):
    """On a line of the curve F = c − b v, so that |f| + b |q̇| = max |f ± b q̇| ≤ c, which is linear in the motion.

    Channels, per axis that states a curve: its speed, then f + b q̇ and f − b q̇ for each line. A line counts wherever
    the speed may lie on its stretch of the curve. The share is the factor by which speed and force together have to
    shrink to lie on the line: 1 is on the curve. Source of the curve: [Sasidhar 1981, 3.2].
    """

    name = "torque-speed"
    terms = frozenset({Term.ONE, Term.SD, Term.SDD, Term.SD2})

    def __init__(self, machine: Machine, path: MachinePath) -> None:
        self.machine, self.path = machine, path
        stated = [k for k, axis in enumerate(machine.axes) if axis.torque_speed is not None and machine.loaded]
        self.curves = {k: Curve.of(machine.axes[k]) for k in stated}
        lines = [line for k, curve in self.curves.items() for line in _lines(k, curve)]
        self.axis, self.pull, self.drop, self.bounds, self.low, self.high, self.near, self.far = _columns(lines)
        self.hull = _columns([line for k, curve in self.curves.items() for line in _lines(k, curve.hull())])
        self.speed_of: np.ndarray = frozen(np.maximum.accumulate(np.where(self.pull == 0, np.arange(len(lines)), 0)))
        self.channels = tuple(machine.axes[line.axis].name for line in lines)
        self.units = tuple(_unit(machine, line) for line in lines)

    @cached_property
    def held(self) -> float:
        """Largest share of what a motor gives at rest that only holds."""
        most = np.abs(held(self.machine, self.path)).max(0)
        return max(float(most[k]) / curve.holding for k, curve in self.curves.items())

    def slowness(self, use: float) -> float:
        return slowness(use, self.held, 1)

    def value(self, motion: Motion) -> Quantity:
        return force(self.machine, motion)[:, self.axis] * self.pull + motion.qd[:, self.axis] * self.drop

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
            near, far = (np.nan_to_num(v / np.abs(slope[:, self.axis]), nan=0.0) for v in (self.near, self.far))
        hull = Rows(sums(*self.hull[:3]), self.hull[3])
        return Rows(sums(self.axis, self.pull, self.drop), self.bounds, about=(near, far), hull=hull)


def _lines(axis: int, curve: Curve) -> list[_Line]:
    found = [_Line(axis, 0.0, 1.0, curve.fastest)]
    near, far = curve.about()
    high = np.append(curve.ends[1:-1], np.inf)
    for i, slope in enumerate(curve.slope.tolist()):
        stretch = float(curve.ends[i]), float(high[i]), float(near[i]), float(far[i])
        found += [_Line(axis, 1.0, drop, float(curve.force[i]), *stretch) for drop in sorted({slope, -slope})]
    return found


def _columns(lines: Sequence[_Line]) -> tuple[np.ndarray, ...]:
    """The fields of all lines, (m,) each."""
    axis, *others = np.array([astuple(line) for line in lines]).reshape(-1, 8).T
    return frozen(axis, int), *map(frozen, others)


def _unit(machine: Machine, line: _Line) -> tuple[str, float]:
    linear = machine.axes[line.axis].kind == "linear"
    if line.pull:
        return ("N" if linear else "N m"), 1.0
    return ("mm/s", 1e3) if linear else ("deg/s", 180 / np.pi)
