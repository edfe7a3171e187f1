"""HOME: the register's zero, which may be any place of the travel, and the slide's place in it, which is the switch's.

[Sasidhar 1981, F.5] zeroes a register at any point of the traverse. What the slide may still do is another matter: it
is counted from the switch, so HOME never takes one for the other.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from controllers.card import Refused
from controllers.console.drives import WHOLE_TOLERANCE
from controllers.console.grammar import Home
from controllers.console.session import Session
from kinematics.foundation.errors import MotionError
from kinematics.foundation.units import quantity
from kinematics.machine.axis import Axis
from planner.pulses.motion import COUNTER

SHOWN_UNITS = {"linear": ("mm", 1e3), "rotary": ("deg", 180 / np.pi)}


def placed(session: Session, words: Home) -> Session:
    """The session with HOME said. Raises Refused for a place outside the travel, or one that cannot be the switch."""
    counts = np.array(session.counts)
    for axis, said in words.places:
        if said is not None:
            counts[axis] = _parse_place(session, axis, said)
        elif not session.homed[axis]:
            counts[axis] = 0
            _refuse_switch(session, axis)
    return session.placed([axis for axis, _ in words.places], counts)


def told(session: Session, axes: Sequence[int]) -> str:
    """What holds now: "HOME X: register 0; X at 609.6 mm of its travel, 0 to 1219.2 mm, steps -38400 to 38400"."""
    names = " ".join(session.drives.names[axis] for axis in axes)
    return "; ".join([f"HOME {names}: register 0", *(_describe_axis(session, axis) for axis in axes)])


def ends(session: Session, axis: int) -> tuple[int, int]:
    """Between what its register may go."""
    first, last = sorted(int(session.registered(end)[axis]) for end in session.window())
    return first, last


def inward(session: Session, axis: int) -> str:
    """The turn of the motor that leads towards the farther end."""
    low, high = session.window()
    up = high[axis] - session.counts[axis] >= session.counts[axis] - low[axis]
    return "CW" if up == (session.drives.signs[axis] > 0) else "CCW"


def example(session: Session, axis: int) -> str:
    """A place that it may have, as HOME takes it."""
    driven = session.machine.axes[axis]
    unit, scale = SHOWN_UNITS[driven.kind]
    middle = sum(driven.travel) / 2 * scale if np.isfinite(driven.travel).all() else 90.0
    return f"{middle:.3g} {unit}"


def _describe_axis(session: Session, axis: int) -> str:
    name, driven = session.drives.names[axis], session.machine.axes[axis]
    unit, scale = SHOWN_UNITS[driven.kind]
    place = f"{name} at {_format_number(session.counts[axis] * driven.pulse * scale)} {unit}"
    if not np.isfinite(driven.travel).all():
        return place
    first, last = ends(session, axis)
    return f"{place} of {_span(driven)}, steps {first} to {last}"


def _format_number(value: float) -> str:
    return f"{round(value, 4) + 0.0:.10g}"


def _parse_place(session: Session, axis: int, said: str) -> int:
    """The counter where the slide stands as was said."""
    name, driven = session.drives.names[axis], session.machine.axes[axis]
    try:
        place = quantity(said, driven.unit)
    except MotionError as error:
        raise Refused(f"HOME {name} AT {said}: {error}") from None
    low, high = min(driven.travel[0], 0.0), max(driven.travel[1], 0.0)
    if not low - WHOLE_TOLERANCE * driven.pulse <= place <= high + WHOLE_TOLERANCE * driven.pulse or _is_beyond_counter(
        place / driven.pulse
    ):
        raise Refused(f"HOME {name} AT {said} is outside {_span(driven)}")
    first, last = (int(end[axis]) for end in session.drives.reach())
    return min(max(int(np.rint(place / driven.pulse)), first), last)


def _is_beyond_counter(count: float) -> bool:
    return not COUNTER[0] <= count <= COUNTER[1]


def _span(driven: Axis) -> str:
    unit, scale = SHOWN_UNITS[driven.kind]
    if not np.isfinite(driven.travel).all():
        return "what its counter holds"
    low, high = (_format_number(end * scale) for end in driven.travel)
    return f"its travel, {low} to {high} {unit}"


def _refuse_switch(session: Session, axis: int) -> None:
    """Raise Refused where it has been at places that would lie beyond its travel, if this one were the switch."""
    low, high = session.drives.reach()
    before, beyond = session.least[axis] - session.counts[axis], session.most[axis] - session.counts[axis]
    if before >= low[axis] and beyond <= high[axis]:
        return
    name, driven = session.drives.names[axis], session.machine.axes[axis]
    unit, scale = SHOWN_UNITS[driven.kind]
    way = (before if before < low[axis] else beyond) * driven.pulse * scale
    raise Refused(
        f"{name} has been {_format_number(way)} {unit} from here, which is not in {_span(driven)}, so "
        "this is not its switch; "
        f"say where the slide stands: HOME {name} AT {example(session, axis)}"
    )
