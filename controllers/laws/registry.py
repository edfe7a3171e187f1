"""The tracking laws by number and by name."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from controllers.laws.closed_loop import (
    ClosedError,
    ClosedErrorSpeed,
    ClosedPosition,
    ClosedPositionTrapezoid,
)
from controllers.laws.law import AnyLaw, Gain
from controllers.laws.nominal import nominal_axes
from controllers.laws.open_loop import (
    Feedforward,
    OpenPosition,
    OpenPositionTrapezoid,
    OpenVelocity,
)
from controllers.laws.predictive import Predictive
from controllers.rig import Rig
from kinematics.foundation.arrays import finite_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import nearest, unknown_name
from kinematics.foundation.options import check_arguments

LAWS: dict[tuple[str, str], Callable[..., AnyLaw]] = {
    ("1", "open-velocity"): OpenVelocity,
    ("2", "open-velocity-sleep"): partial(OpenVelocity, host="sleep"),
    ("3", "open-position"): OpenPosition,
    ("3o", "open-position-trapezoid"): OpenPositionTrapezoid,
    ("3t", "closed-position-trapezoid"): ClosedPositionTrapezoid,
    ("4", "closed-error"): ClosedError,
    ("5", "closed-error-speed"): ClosedErrorSpeed,
    ("6", "closed-position"): ClosedPosition,
    ("7", "closed-position-relative"): partial(ClosedPosition, relative=True),
    ("6r", "closed-position-repaired"): partial(ClosedPosition, repaired=True),
    ("7r", "closed-position-relative-repaired"): partial(
        ClosedPosition, relative=True, repaired=True
    ),
    ("ff", "feedforward"): Feedforward,
    ("mpc", "predictive"): Predictive,
}
"""(number of the thesis' algorithm, or ours, and name) -> law; gains, the keys of its grid, are
keyword arguments.
"""


def law_names() -> tuple[str, ...]:
    """Names of the tracking laws."""
    return tuple(name for _, name in LAWS)


@check_arguments()
def find_law(name: str, rig: Rig | None = None, **gains: Gain) -> AnyLaw:
    """Find a tracking law by number or name.

    Parameters
    ----------
    name
        "6" or "closed-position"; `law_names` lists the names.
    rig
        Whose nominal axes a law by model is to assume; it must be the rig as stated, also where
        others are tried.
    gains
        The law's gains, each a number or (B, 1) with one value for each run of a batch.

    Returns
    -------
    Law
        With the given gains, and its usual ones where none are given.

    Raises
    ------
    MotionError
        The name or a gain is unknown; the nearest is told.
    """
    for gain, value in gains.items():
        finite_array(value, f"law {name}: {gain}")
    for known, make in LAWS.items():
        if name in known:
            own = make().grid
            for gain in gains:
                if gain not in own:
                    near = nearest(gain, own)
                    raise MotionError(
                        f"law {name} has no gain {gain!r}{near}: choose among {', '.join(own) or 'none'}"
                    )
            law = make(**gains)
            if rig is not None and isinstance(law, Feedforward | Predictive):
                return replace(law, axes=nominal_axes(rig))
            return law
    raise unknown_name("law", name, [word for known in LAWS for word in known])
