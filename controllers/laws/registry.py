"""The tracking laws by number and by name."""

from collections.abc import Callable, Sequence
from difflib import get_close_matches
from functools import partial

from controllers.laws.closed_error import ClosedError, ClosedErrorSpeed
from controllers.laws.closed_position import ClosedPosition
from controllers.laws.gain import Gain
from controllers.laws.law import Law
from controllers.laws.open_position import OpenPosition, OpenPositionTrapezoid
from kinematics.errors import MotionError

LAWS: dict[tuple[str, str], Callable[..., Law]] = {
    ("3", "open-position"): OpenPosition,
    ("3t", "open-position-trapezoid"): OpenPositionTrapezoid,
    ("4", "closed-error"): ClosedError,
    ("5", "closed-error-speed"): ClosedErrorSpeed,
    ("6", "closed-position"): ClosedPosition,
    ("7", "closed-position-relative"): partial(ClosedPosition, relative=True),
    ("6r", "closed-position-repaired"): partial(ClosedPosition, repaired=True),
    ("7r", "closed-position-relative-repaired"): partial(ClosedPosition, relative=True, repaired=True),
}
"""(number of the thesis' algorithm, name) -> law; gains, the keys of its grid, are keyword arguments."""


def law_names() -> tuple[str, ...]:
    """Names of the laws."""
    return tuple(name for _, name in LAWS)


def find_law(name: str, **gains: Gain) -> Law:
    """The law of a number ("6") or name ("closed-position"), with gains other than its own. Raises MotionError."""
    for known, make in LAWS.items():
        if name in known:
            own = make().grid
            for gain in gains:
                if gain not in own:
                    raise MotionError(f"law {name} has no gain {gain!r}: choose among {', '.join(own) or 'none'}")
            return make(**gains)
    choices = [word for known in LAWS for word in known]
    nearest = get_close_matches(name, choices, 1)
    hint = f"; did you mean {nearest[0]!r}?" if nearest else ""
    raise MotionError(f"law {name!r} is not known: choose among {', '.join(choices)}{hint}")
