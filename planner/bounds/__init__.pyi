from .duration_bound import (
    DurationBound as DurationBound,
    bound_duration as bound_duration,
)
from .limit_worth import (
    ALL as ALL,
    LimitChange as LimitChange,
    Worth as Worth,
    find_worth as find_worth,
)
from .lower_bound import (
    bound_cells as bound_cells,
    enclose_rows as enclose_rows,
)
from .rest import bound_rest as bound_rest, leave_rest as leave_rest
