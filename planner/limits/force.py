"""Force of every actuator: |f| ≤ F, of masses, gravity, friction and what pushes on the platform."""

from functools import cached_property

import numpy as np

from kinematics.array import Array
from kinematics.machine import Machine
from kinematics.series import Series
from planner.actuation import MachinePath, Points, points_of
from planner.limits.holding import force_units
from planner.limits.limit import AxisLimit, Motion, Quantity, Rows, Term

# Points of a piece at which the force that only holds is looked at; it shapes how much a motion is slowed, no proof.
LOOKED = 17
# Order of a force's expansion in time: bounds are as tight as with 6 on pieces of a few milliseconds, at half the cost.
EXPANSION = 3


def force(machine: Machine, motion: Motion) -> Quantity:
    """f(x, ẋ, ẍ, q, q̇, q̈) (N, n); of an enclosure to a low order, since its many products cost the order squared."""
    inputs = [*(motion.pose_rate(times) for times in range(3)), motion.q, motion.qd, motion.qdd]
    short = [value.cut(EXPANSION) if isinstance(value, Series) else value for value in inputs]
    return machine.force_map.force(motion.evaluate(machine.force_map.expression, *short))


def force_terms(machine: Machine, points: Points) -> dict[Term, Array]:
    """What multiplies 1, ṡ, ṡ², s̈ in f, by its values at rest and for unit rates: ẋ = x′ṡ, ẍ = x′s̈ + x″ṡ²."""
    x, x1, x2 = points.pose_derivatives
    q, q1, q2, *_ = points.derivatives
    still, none = np.zeros_like(x), np.zeros_like(q)
    held, pushed, carried = (
        machine.force_map(np.concatenate([x, first, second, q, turn, bend], 1))
        for first, second, turn, bend in ((still, still, none, none), (still, x1, none, q1), (x1, x2, q1, q2))
    )
    rubbed = q1 * [axis.friction for axis in machine.axes]
    return {Term.ONE: held, Term.SD: rubbed, Term.SD2: carried - held - rubbed, Term.SDD: pushed - held}


def held(machine: Machine, path: MachinePath) -> Array:
    """(N, n) the forces that hold still, at points all along a path."""
    piece = np.repeat(np.arange(len(path.pieces)), LOOKED)
    s = (path.breaks[:-1, None] + np.diff(path.breaks)[:, None] * np.linspace(0, 1, LOOKED)).ravel()
    points = points_of(path, s, piece, 2)
    return machine.holding_map(np.concatenate([points.pose_derivatives[0], points.derivatives[0]], 1))


def slowness(use: float, held: float, power: int) -> float:
    """k of a motion k times slower that uses 1 of a limit, where it used `use` and what only holds uses `held`.

    What moves falls by k^power at least: held + (use − held)/k^power ≤ 1.
    """
    share = min(held, 1 - 1e-6)
    return float(((max(use, 1.0) - share) / (1 - share)) ** (1 / power))


class Force(AxisLimit):
    """One number per axis, at every speed."""

    name, dimension = "force", ""

    def __init__(self, machine: Machine, path: MachinePath) -> None:
        super().__init__(machine.axes, [axis.max_force if machine.loaded else None for axis in machine.axes])
        self.machine, self.path, self.units = machine, path, force_units(machine)
        rubs = any(axis.friction for axis in machine.axes)
        self.terms = frozenset({Term.ONE, Term.SDD, Term.SD2} | ({Term.SD} if rubs else set()))

    @cached_property
    def held(self) -> float:
        """Largest share that only holds."""
        return float((np.abs(held(self.machine, self.path)) / self.bounds).max())

    def slowness(self, use: float) -> float:
        return slowness(use, self.held, 1 if Term.SD in self.terms else 2)

    def value(self, motion: Motion) -> Quantity:
        return force(self.machine, motion)

    def rows(self, points: Points) -> Rows:
        found = force_terms(self.machine, points)
        return Rows({term: found[term] for term in found if term in self.terms}, self.bounds)
