"""What a classical timing would take for the same program: the baseline of every saving that is quoted."""

from dataclasses import dataclass

from kinematics.errors import MotionError
from planner.baselines.along import Along
from planner.baselines.between import Deviation, deviation, independent, moves, synchronised
from planner.certify import Certificate, certify
from planner.limits import limits_of
from planner.limits.travel import Travel
from planner.plan import Plan
from planner.solve import proved
from planner.timing.shapes import QUARTER_SINE, S_CURVE, TRAPEZOID
from planner.trajectory import Trajectory

# Along the path: one profile of speed for each run from rest to rest.
ALONG = {shapes.name: shapes for shapes in (TRAPEZOID, S_CURVE, QUARTER_SINE)}
# Between poses: every axis on its own from the end of one segment to the end of the next.
BETWEEN = {"synchronised": synchronised, "independent": independent}
KINDS = (*ALONG, *BETWEEN)


@dataclass(frozen=True, slots=True)
class Classical:
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


def classical(plan: Plan, kind: str = "trapezoid") -> Classical:
    """The classical timing of a plan's program, as fast as its kind can be within the same limits.

    Along the path: "trapezoid", "s-curve" (seven pieces of constant jerk) and "quarter-sine", in arc length, each run
    the quickest of its kind, scaled until certified; all but the s-curve at order 2, since their accelerations step.
    Between poses: "synchronised" [Sahbaz 2007] and "independent" [Sasidhar 1981], trapezoids of every axis at its own
    limits of speed and acceleration, certified for these and for travel; the deviation says how far they leave the
    path. Raises MotionError for another kind, an s-curve without jerk limits, or where no proof is found.
    """
    if kind in BETWEEN:
        return _between(plan, kind)
    if kind not in ALONG:
        raise MotionError(f'classical timing "{kind}" is not known; there are {", ".join(KINDS)}')
    shapes = ALONG[kind]
    if shapes.order == 3 and all(axis.max_jerk is None for axis in plan.machine.axes):
        raise MotionError(f"classical timing {kind}: no axis states a jerk limit; state one, or choose another kind")
    limits = limits_of(plan.path, plan.machine.axes, shapes.order)
    solution = proved(plan.path, limits, shapes.order, Along(shapes))
    return Classical(kind, shapes.order, solution.trajectory, solution.certificate)


def _between(plan: Plan, kind: str) -> Classical:
    machine = plan.machine
    trajectory, begins = moves(plan.path, machine.axes, BETWEEN[kind])
    travel = Travel(machine.axes, machine.home_q)
    limits = [*limits_of(trajectory.path, machine.axes, 2), *([travel] if (travel.bounds < float("inf")).any() else [])]
    certificate = certify(trajectory, limits)
    return Classical(kind, 2, trajectory, certificate, deviation(machine, plan.path, trajectory, begins))
