from .limit import Limit as Limit, Rows as Rows, Term as Term
from .registry import (
    OwnLimit as OwnLimit,
    find_unkept_limits as find_unkept_limits,
    limits_of as limits_of,
    usual_order as usual_order,
)
