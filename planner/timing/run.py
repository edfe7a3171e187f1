"""One run between stops: discretized, solved, and solved again with less room while it is seen to exceed a limit."""

from collections.abc import Sequence
from dataclasses import replace

from kinematics.foundation.errors import MotionError
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath
from planner.place import Infeasible
from planner.timing.certified_run import tighten_until_kept
from planner.timing.feed_limited import sketch_problem, solve_feed_limited
from planner.timing.grid import acceleration_problem, refine_problem, unbounded_error
from planner.timing.jerk_limited import solve_leg, solve_legs
from planner.timing.order2.closed_form import straight
from planner.timing.order2.second_order import estimate_lower_bound, second_order
from planner.timing.problem import Run
from planner.timing.profile import RunSolution, TooFast


def solve_run(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, *, probing: bool = False
) -> RunSolution:
    """The fastest motion along a run. Infeasible for end speeds that cannot be, stopped where nothing bounds it.

    probing: just one solve, for whoever has other runs to try if it gives no answer or none that holds.
    """
    if not probing:
        quick = _solve_in_closed_form(path, limits, run, order)
        if quick is not None:
            return _place_refusal(path, run, quick)
    if order == 3:
        found = solve_leg(path, limits, run) if probing else solve_legs(path, limits, run)
        return _place_refusal(path, run, found)
    problem = acceleration_problem(path, limits, run)
    unbounded = unbounded_error(problem, order)
    if unbounded is not None:
        return RunSolution.refused(unbounded)
    exact = straight(problem)
    if exact is not None:
        found = exact
    else:
        found = second_order(problem, solver=run.solver)
        finer = refine_problem(path, limits, problem, found.profile) if found.solved else None
        if finer is not None:
            found = second_order(finer, solver=run.solver)
        if found.solved and found.problem is not None and run.continuation is None:
            least = estimate_lower_bound(found.problem, found.profile if run.solver == "passes" else None)
            found = RunSolution.refused(least) if isinstance(least, MotionError) else replace(found, bound=least)
    if not probing and found.solved:
        # the proof looks at every limit: here at those that can matter
        rows = None if found.problem is None else {block.name for block in found.problem.blocks}
        watched = [limit for limit in limits if rows is None or limit.name in rows]
        found = tighten_until_kept(path, watched, found)
    return _place_refusal(path, run, found)


def _solve_in_closed_form(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int) -> RunSolution | None:
    """Find the motion of a straight or feed-limited run from its rows at a few places.

    None where the run is neither, or where nothing bounds its acceleration or jerk.
    """
    sketch = sketch_problem(path, limits, run)
    if unbounded_error(sketch, order) is not None:
        return None
    if run.continuation is None:
        exact = straight(sketch)
        if exact is not None:
            return exact if exact.solved else None
    else:  # its grid is needed only where the run is solved as a whole
        run = replace(run, continuation=None)
    if run.whole:
        return None

    def solve(part: Run) -> RunSolution:
        return solve_run(path, limits, part, order)

    return solve_feed_limited(path, limits, run, sketch, solve, order=order)


def _place_refusal(path: ActuatorPath, run: Run, found: RunSolution) -> RunSolution:
    """Where along the path a speed at an end is too fast, which solvers do not know."""
    no = found.refusal
    if not isinstance(no, TooFast):
        return found
    place = path.place(float(run.breaks(path)[-no.end]), (run.first, run.last)[no.end])
    unit, scale = ("mm/s", 1e3) if place.segment is not None else ("/s", 1.0)
    remedy = f"{no.largest * scale:.6g} {unit} is the largest that the limits allow"
    remedy += ", from rest or to rest at the other end: both are too high" if no.both else ""
    return RunSolution.refused(Infeasible(no.name, "path", place, no.speed * scale, no.largest * scale, unit, remedy))
