from .heat import measure_heat as measure_heat, solve_objective as solve_objective
from .objective import TIME as TIME, Objective as Objective, read_objective as read_objective
