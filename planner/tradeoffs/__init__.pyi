from .heat import measure_heat as measure_heat, solve_objective as solve_objective
from .limit_worth import ALL as ALL, LimitChange as LimitChange, Worth as Worth, find_worth as find_worth
from .objective import TIME as TIME, Objective as Objective, read_objective as read_objective
