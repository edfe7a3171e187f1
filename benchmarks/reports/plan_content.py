"""The content of a plan's report: the plan, and the results that were found about it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan

from benchmarks.reports.page import Picture
from controllers.metrics import Metrics
from controllers.rig import Rig
from kinematics.foundation.table import Table
from planner.activity import Activity
from planner.baselines import Classical
from planner.bounds.limit_worth import LimitChange, Worth
from planner.cross_check import CrossCheck
from planner.interruption.hold import Stops
from planner.overview import Overview
from planner.plan import Plan
from planner.plan_parts import PlanStanding
from planner.pulses import PulseCheck, RealisedPath
from planner.shaping.shaped_proof import ShapedProof


@dataclass(frozen=True, slots=True)
class PlanReport:
    """The content of a plan's report. A part of the page without its result is left out.

    plan       plan of the report; of one that was made in parts and not loaded, its standing
    verdict    of the independent check of its pulses; None: no file of pulses was requested
    overview   of a plan in parts: extremes of the motion over windows of time
    activity   of a plan in parts: active limits over windows of time
    ending     why the motion ends before the program
    classical  baseline of the saving
    others     further baseline timings, for the table
    metrics    errors of each tracking law; without them the page says how to get them
    rig        rig that the laws were run on
    untracked  reason why there are no errors, or the rig to choose for them
    realised   path that the pulses make
    crossed    comparison with toppra's motion
    worth      worth of the limits
    change     motion with more of one limit
    unbounded  reason why there is no worth
    stops      soonest stops
    figures    figures as `draw` gives them, all or some; None: `write_report` draws them
    scene      page of the machine in motion, from `benchmarks.animation`
    drives     tables of the times on STEP and DIR against the needs of the drives
    triggers   tables of the triggers; None: those of the plan
    left_out   results that were left out to save time, each with the option that asks for it
    """

    plan: Plan | PlanStanding
    verdict: PulseCheck | None = None
    overview: Overview | None = None
    activity: Activity | None = None
    ending: str = ""
    classical: Classical | None = None
    others: Sequence[Classical] = ()
    metrics: Sequence[Metrics] = ()
    rig: Rig | None = None
    untracked: str = ""
    realised: RealisedPath | None = None
    crossed: CrossCheck | None = None
    worth: Worth | None = None
    change: LimitChange | None = None
    unbounded: str = ""
    stops: Stops | None = None
    figures: Mapping[str, Picture] | None = None
    scene: str = ""
    drives: Sequence[Table] = ()
    triggers: Sequence[Table] | None = None
    left_out: Sequence[str] = ()

    @property
    def whole(self) -> Plan:
        """Plan with its whole motion. A plan in parts has none unless it is loaded."""
        assert isinstance(self.plan, Plan)
        return self.plan

    @property
    def shaped(self) -> ShapedProof | None:
        """Proof of the motion after the input shapers, for which a plan is made as a whole."""
        return self.plan.shaped if isinstance(self.plan, Plan) else None

    @property
    def time_saved(self) -> float:
        """Time (s) saved against the baseline; negative if the baseline is faster, with fewer
        limits.

        NaN: there is no baseline.
        """
        if self.classical is None:
            return nan
        return self.classical.duration - self.whole.trajectory.duration
