from .baselines import Classical as Classical, classical as classical
from .certificate.certify import Certificate as Certificate
from .certificate.feasibility import Standing as Standing
from .orientation.orient import orient as orient
from .place import Infeasible as Infeasible, Place as Place
from .plan_many import plan_many as plan_many
from .geometric_check import check as check
from .plan import Plan as Plan, plan as plan
from .plan_parts import PlanPart as PlanPart, PlanStanding as PlanStanding, plan_parts as plan_parts
from .program.model import (
    Arc as Arc,
    Curve as Curve,
    Dwell as Dwell,
    Line as Line,
    Program as Program,
    Spline as Spline,
    Synchronised as Synchronised,
    Turn as Turn,
)
from .program.modifiers import (
    Blend as Blend,
    Fit as Fit,
    Free as Free,
    Stop as Stop,
    Through as Through,
    Trigger as Trigger,
)
from .program.program_file import load_program as load_program, program_names as program_names
from .path.point_to_point import synchronise as synchronise
from .pulses import (
    PulseFile as PulseFile,
    PulseSchedule as PulseSchedule,
    RealisedPath as RealisedPath,
    open_pulses as open_pulses,
    read_pulses as read_pulses,
    realised as realised,
)
from .sources.arm_simulation import simulate_arms as simulate_arms
from .sources.position_list import PositionList as PositionList, save_positions as save_positions
from .sources.positions import load_positions as load_positions
from .sources.source import import_program as import_program
from .time_optimal import time_optimal as time_optimal
from .timing.certified_solve import Solution as Solution
from .bounds.limit_worth import LimitChange as LimitChange, Worth as Worth
from .timing.goals.objective import Objective as Objective
from .trajectory import State as State, Trajectory as Trajectory
from .pulses.triggers import Triggered as Triggered
