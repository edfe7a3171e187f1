"""What a classical timing would take for the same program: the baseline of every saving that is quoted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from kinematics.axis import Axis
from kinematics.errors import MotionError
from kinematics.result import Result
from kinematics.table import Column, Table
from planner.actuation import MachinePath, actuate
from planner.baselines.along import Along
from planner.baselines.between import Deviation, deviation, independent, moves, synchronised
from planner.certify import Certificate, certify
from planner.course import Course
from planner.limits import Limit, limits_of
from planner.limits.travel import Travel
from planner.plan import Plan
from planner.program import stopping
from planner.solve import proved
from planner.timing.shapes import QUARTER_SINE, S_CURVE, TRAPEZOID
from planner.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Along the path: one profile of speed for each run from rest to rest.
ALONG = {shapes.name: shapes for shapes in (TRAPEZOID, S_CURVE, QUARTER_SINE)}
# Between poses: every axis on its own from the end of one segment to the end of the next.
BETWEEN = {"synchronised": synchronised, "independent": independent}
KINDS = (*ALONG, *BETWEEN)


@dataclass(frozen=True, slots=True)
class Classical(Result):
    """A classical motion of a kind, and its own proof.

    order      to which its proof goes: 2 where its acceleration steps, so that no jerk limit could hold
    deviation  how far it leaves the programmed curve; None: it follows it
    """

    kind: str
    order: int
    trajectory: Trajectory
    certificate: Certificate
    deviation: Deviation | None = None

    @property
    def duration(self) -> float:
        return self.trajectory.duration

    def tables(self) -> tuple[Table, ...]:
        """How long it takes, how far it leaves the path, and its certificate."""
        off = 0.0 if self.deviation is None else self.deviation.distance
        columns = (
            Column("timing", [self.kind]),
            Column("order", [self.order]),
            Column("duration", [self.duration], "s", form=".6f"),
            Column("off the path", [off], "m", "human", ".3f"),
        )
        return Table("classical timing", columns), *self.certificate.tables()

    def data(self) -> Table:
        """The motion over time."""
        return self.trajectory.data()

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """The speed along the path over time."""
        return self.trajectory.plot(ax)


def classical(plan: Plan | Course, kind: str = "trapezoid") -> Classical:
    """The classical timing of a program, planned or not yet, as fast as its kind can be within the same limits.

    Along the path: "trapezoid", "s-curve" (seven pieces of constant jerk) and "quarter-sine", in arc length, each run
    the quickest of its kind, scaled until certified; all but the s-curve at order 2, since their accelerations step.
    Between poses: "synchronised" [Sahbaz 2007] and "independent" [Sasidhar 1981], trapezoids of every axis at its own
    limits of speed and acceleration, certified for these and for travel; the deviation says how far they leave the
    path. Every join is a stop, from rest to rest, also where the program begins or ends at a speed, and no speed is
    kept constant. Raises MotionError for another kind, an s-curve without jerk limits, or where no proof is found.
    """
    if kind in BETWEEN:
        return _between(plan, kind)
    if kind not in ALONG:
        raise MotionError(f'classical timing "{kind}" is not known; there are {", ".join(KINDS)}')
    shapes = ALONG[kind]
    if shapes.order == 3 and all(axis.max_jerk is None for axis in plan.machine.axes):
        raise MotionError(f"classical timing {kind}: no axis states a jerk limit; state one, or choose another kind")
    path, standing = _stopping(plan)
    limits = _with(standing, limits_of(path, _axes(plan), shapes.order))
    solution = proved(path, limits, shapes.order, Along(shapes))
    return Classical(kind, shapes.order, solution.trajectory, solution.certificate)


_STOPPED: WeakKeyDictionary[MachinePath, tuple[MachinePath, tuple[Limit, ...]]] = WeakKeyDictionary()


def _stopping(plan: Plan | Course) -> tuple[MachinePath, tuple[Limit, ...]]:
    """The path with a stop at every join, and what no timing can help along it.

    It is one path for all kinds, and the plan's own if that stops so, since what place alone asks is proved once for
    each path.
    """
    if plan.path.stops(2).all() and plan.path.end_speeds == (0.0, 0.0):
        return plan.path, tuple(limit for limit in plan.limits if limit.geometric)
    if plan.path not in _STOPPED:
        path = actuate(replace(stopping(plan.program), start_speed=0.0, end_speed=0.0), plan.machine)
        limits = limits_of(path, plan.machine.axes, 2)
        _STOPPED[plan.path] = path, tuple(limit for limit in limits if limit.geometric)
    return _STOPPED[plan.path]


def _with(standing: Sequence[Limit], limits: Sequence[Limit]) -> tuple[Limit, ...]:
    """The limits, those that no timing can help as they stand already."""
    known = {limit.name: limit for limit in standing}
    return tuple(known.get(limit.name, limit) for limit in limits)


def _axes(plan: Plan | Course) -> list[Axis]:
    # classical timings know no way round a resonance band: what a timed crossing would cost them is left out
    return [
        replace(axis, resonance=None, resonance_time=None) if axis.resonance_time else axis
        for axis in plan.machine.axes
    ]


def _between(plan: Plan | Course, kind: str) -> Classical:
    machine, (path, _), axes = plan.machine, _stopping(plan), _axes(plan)
    trajectory, begins = moves(path, axes, BETWEEN[kind])
    travel = Travel(machine.axes, machine.home_q)
    limits = [*limits_of(trajectory.path, axes, 2), *([travel] if (travel.bounds < float("inf")).any() else [])]
    certificate = certify(trajectory, limits)
    return Classical(kind, 2, trajectory, certificate, deviation(machine, path, trajectory, begins))
