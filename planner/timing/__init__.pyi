from .attempts import solve_once as solve_once, solve_run as solve_run
from .certified_solve import (
    BEFORE_SHAPERS as BEFORE_SHAPERS,
    Solution as Solution,
    certified_solve as certified_solve,
    solve_within as solve_within,
    timing_table as timing_table,
)
from .goals.constant_speed import ConstantSpeed as ConstantSpeed
from .goals.goal import Goal as Goal
from .goals.heat import measure_heat as measure_heat, solve_objective as solve_objective
from .goals.objective import (
    TIME as TIME,
    Objective as Objective,
    read_objective as read_objective,
)
from .goals.stated_duration import solve_stated as solve_stated
from .grid import (
    Task as Task,
    acceleration_problem as acceleration_problem,
    coarse_jerk_problem as coarse_jerk_problem,
    jerk_problem as jerk_problem,
    make_grid as make_grid,
    refine_problem as refine_problem,
)
from .order2.passes import largest_speeds as largest_speeds
from .order2.second_order import second_order as second_order
from .problem import (
    REST as REST,
    SOLVER_AIM as SOLVER_AIM,
    Block as Block,
    Continuation as Continuation,
    EndCondition as EndCondition,
    Problem as Problem,
    Run as Run,
    Settings as Settings,
    Solver as Solver,
    at_speeds as at_speeds,
)
from .profile import Profile as Profile, close_profile as close_profile
from .rows import pose_problem as pose_problem
from .sampling import sample_limit_use as sample_limit_use
from .solution import RunSolution as RunSolution
from .order3.solve import solve_jerk_limited as solve_jerk_limited, third_order as third_order
from .tighten import lower_rooms as lower_rooms
