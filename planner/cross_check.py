"""A second opinion on a plan: the fastest motion of order 2 by toppra beside our own, each with its certificate."""

from dataclasses import dataclass, field
from functools import partial

from kinematics.files.plain_text import finite_or_none
from kinematics.foundation.errors import MotionError, attempt
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.limits.limit import Term
from planner.plan import Plan
from planner.timing.certified_solve import Solution, certified_solve
from planner.timing.solvers.toppra_ import require


@dataclass(frozen=True, slots=True)
class CrossCheck(Result):
    """The motions of order 2 of one path within the same limits, those on jerk left out.

    ours: the plan's own where it is of order 2, else made for this; theirs: toppra's, certified or not, None where it
    gives no motion, and `failure` tells why. toppra solves the rows that our own solver solves (on a grid, kept at both
    ends of every interval), and its motion is proved, and solved again with less room, as ours is.
    """

    ours: Solution = field(repr=False)
    theirs: Solution | None = field(repr=False)
    failure: str = ""

    @property
    def difference(self) -> float | None:
        """By what share of ours toppra's motion takes longer; negative where it is shorter."""
        if self.theirs is None:
            return None
        return self.theirs.trajectory.duration / self.ours.trajectory.duration - 1

    def tables(self) -> tuple[Table, ...]:
        """Both durations, whether each is certified, and the worst proven use of every limit."""
        both = {"pulsepath": self.ours} | ({} if self.theirs is None else {"toppra": self.theirs})
        times = Column("duration", [one.trajectory.duration for one in both.values()], "s", form=".6f")
        certified = Column("certified", ["yes" if one.certificate.holds else "NO" for one in both.values()])
        if self.difference is None:
            told = f"toppra gave no motion: {self.failure}"
        else:
            told = f"toppra's motion takes {100 * self.difference:+.6f} % longer"
        names = list(dict.fromkeys(name for one in both.values() for name in one.certificate.worst))
        uses = (
            Column(by, [one.certificate.worst.get(name) for name in names], form=".7f", up=True)
            for by, one in both.items()
        )
        return (
            Table("cross-check at order 2, without limits on jerk", (Column("by", [*both]), times, certified), (told,)),
            Table("cross-check: value/limit, bounded over continuous time", (Column("limit", names), *uses)),
        )

    def record(self) -> dict[str, object]:
        """Both motions as plain data; None where toppra gave none, and why."""
        both = {"pulsepath": self.ours, "toppra": self.theirs}
        told = {name: None if one is None else _record(one) for name, one in both.items()}
        return {"order": 2, **told, "difference": self.difference, "failure": self.failure or None}


def _record(one: Solution) -> dict[str, object]:
    worst = {limit: finite_or_none(ratio) for limit, ratio in one.certificate.worst.items()}
    holds = one.certificate.holds
    return {"duration_s": one.trajectory.duration, "certified": holds, "worst_ratios": worst}


def cross_check(plan: Plan) -> CrossCheck:
    """Both motions of order 2 of a plan's path. Raises NotInstalled where toppra is not there."""
    require("a cross-check")
    limits = tuple(limit for limit in plan.limits if Term.SDDD not in limit.terms)
    if plan.order == 2 and plan.fastest and not any("toppra" in method for method in plan.methods):
        own = plan.trajectory, plan.certificate, limits, 2, plan.rounds, plan.methods, plan.lower_estimate
        ours = Solution(*own)
    else:
        ours = certified_solve(plan.path, limits, 2)
    theirs = attempt(partial(certified_solve, plan.path, limits, 2, solver="toppra", proving=False))
    return CrossCheck(ours, None, str(theirs)) if isinstance(theirs, MotionError) else CrossCheck(ours, theirs)
