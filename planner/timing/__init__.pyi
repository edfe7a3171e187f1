from .certified_run import Timing as Timing
from .certified_solve import (
    BEFORE_SHAPERS as BEFORE_SHAPERS,
    Solution as Solution,
    certified_solve as certified_solve,
    solve_within as solve_within,
    timing_table as timing_table,
)
from .discretization import (
    acceleration_problem as acceleration_problem,
    coarse_jerk_problem as coarse_jerk_problem,
    jerk_problem as jerk_problem,
    refine_problem as refine_problem,
)
from .problem import (
    SOLVER_AIM as SOLVER_AIM,
    Block as Block,
    Continuation as Continuation,
    Problem as Problem,
    Run as Run,
    Solver as Solver,
    make_grid as make_grid,
    pose_problem as pose_problem,
)
from .profile import (
    Profile as Profile,
    RunSolution as RunSolution,
    close_profile as close_profile,
    sample_limit_use as sample_limit_use,
)
from .run import solve_run as solve_run
from .solvers.passes import largest_speeds as largest_speeds
from .solvers.second_order import second_order as second_order
from .solvers.third_order import solve_jerk_limited as solve_jerk_limited, third_order as third_order
from .stated_duration import solve_stated as solve_stated
