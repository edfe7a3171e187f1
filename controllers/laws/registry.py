"""The tracking laws by number and by name."""

from collections.abc import Callable
from difflib import get_close_matches
from inspect import signature

from controllers.laws.closed_position import ClosedPosition
from controllers.laws.law import Law
from controllers.laws.open_position import OpenPosition
from kinematics.errors import MotionError

LAWS: dict[tuple[str, str], Callable[..., Law]] = {
    ("3", "open-position"): OpenPosition,
    ("6", "closed-position"): ClosedPosition,
}
"""(number of the thesis' algorithm, name) -> law; gains are keyword arguments."""


def law_names() -> tuple[str, ...]:
    """Names of the laws."""
    return tuple(name for _, name in LAWS)


def find_law(name: str, **gains: float) -> Law:
    """The law of a number ("6") or name ("closed-position"), with gains other than its own. Raises MotionError."""
    for known, law in LAWS.items():
        if name in known:
            own = signature(law).parameters
            for gain in gains:
                if gain not in own:
                    raise MotionError(f"law {name} has no gain {gain!r}: choose among {', '.join(own) or 'none'}")
            return law(**gains)
    choices = [word for known in LAWS for word in known]
    nearest = get_close_matches(name, choices, 1)
    hint = f"; did you mean {nearest[0]!r}?" if nearest else ""
    raise MotionError(f"law {name!r} is not known: choose among {', '.join(choices)}{hint}")
