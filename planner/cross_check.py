"""A comparison of a plan with toppra's fastest motion of order 2, each with its certificate."""

from dataclasses import dataclass, field
from functools import partial

from kinematics.files.plain_text import finite_or_none
from kinematics.foundation.errors import MotionError, attempt
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.limits.limit import Term
from planner.plan import Plan
from planner.timing.certified_solve import Solution, certified_solve, choose_goal, solve_goal
from planner.timing.certify_loop import RunCertifier
from planner.timing.order2.toppra_ import require
from planner.timing.problem import Settings


@dataclass(frozen=True, slots=True)
class CrossCheck(Result):
    """The motions of order 2 of one path within the same limits, without those on jerk.

    ours     the plan's motion if it is of order 2, else a new one
    theirs   toppra's motion, certified or not; None if it gives none
    failure  the reason if toppra gives none

    toppra solves the rows of our own solver, on a grid, at both ends of each interval. Its motion
    is proved as ours is, and solved again with smaller limits if the proof fails.
    """

    ours: Solution = field(repr=False)
    theirs: Solution | None = field(repr=False)
    failure: str = ""

    @property
    def difference(self) -> float | None:
        """Share of our duration by which toppra's motion takes longer; negative if it is
        shorter.
        """
        if self.theirs is None:
            return None
        return self.theirs.trajectory.duration / self.ours.trajectory.duration - 1

    def tables(self) -> tuple[Table, ...]:
        """Return both durations, whether each is certified, and the worst use of each limit."""
        both = {"pulsepath": self.ours}
        note = f"toppra gave no motion: {self.failure}"
        if self.theirs is not None and self.difference is not None:
            both["toppra"] = self.theirs
            note = f"toppra's motion takes {100 * self.difference:+.6f} % longer"
        durations = [one.trajectory.duration for one in both.values()]
        proofs = {by: one.certificate for by, one in both.items()}
        motions = (
            Column("by", [*both]),
            Column("duration", durations, "s", form=".6f"),
            Column("certified", ["yes" if proof.holds else "NO" for proof in proofs.values()]),
        )
        names = list(dict.fromkeys(name for proof in proofs.values() for name in proof.worst))
        uses = (
            Column(by, list(map(proof.worst.get, names)), form=".7f", up=True)
            for by, proof in proofs.items()
        )
        title = "cross-check: value/limit, bounded over continuous time"
        return (
            Table("cross-check at order 2, without limits on jerk", motions, (note,)),
            Table(title, (Column("limit", names), *uses)),
        )

    def record(self) -> dict[str, object]:
        """Return both motions as plain data; None if toppra gave none, and the reason."""
        return {
            "order": 2,
            "pulsepath": _record(self.ours),
            "toppra": None if self.theirs is None else _record(self.theirs),
            "difference": self.difference,
            "failure": self.failure or None,
        }


def _record(one: Solution) -> dict[str, object]:
    worst = {limit: finite_or_none(ratio) for limit, ratio in one.certificate.worst.items()}
    holds = one.certificate.holds
    return {"duration_s": one.trajectory.duration, "certified": holds, "worst_ratios": worst}


def cross_check(plan: Plan) -> CrossCheck:
    """Compare both motions of order 2 of a plan's path. Raises NotInstalled without toppra."""
    require("a cross-check")
    limits = tuple(limit for limit in plan.limits if Term.SDDD not in limit.terms)
    if plan.order == 2 and plan.fastest and not any("toppra" in method for method in plan.methods):
        ours = Solution(
            plan.trajectory,
            plan.certificate,
            limits,
            2,
            plan.rounds,
            plan.methods,
            plan.lower_estimate,
        )
    else:
        ours = certified_solve(plan.path, limits, 2)
    certifier = RunCertifier(plan.path, limits, 2, choose_goal(plan.path))
    theirs = attempt(partial(solve_goal, certifier, settings=Settings(solver="toppra")))
    if isinstance(theirs, MotionError):
        return CrossCheck(ours, None, str(theirs))
    return CrossCheck(ours, theirs)
