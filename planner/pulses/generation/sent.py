"""What axes were sent before a motion begins: the pulses of a stop, or of the way on, go on from
there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.errors import MotionError
from planner.pulses.generation.spacing import GivenPulse, LeastGaps, Travel
from planner.pulses.schedule import AxisPulses, PulseSchedule


@dataclass(frozen=True, slots=True)
class SentPulses:
    """Of an axis before a tick: the count that its pulses lead to, and the last of them, its ticks
    from that tick.
    """

    count: int
    last: GivenPulse | None = None


def find_sent(
    schedule: PulseSchedule, tick: int, before: Sequence[SentPulses] = ()
) -> tuple[SentPulses, ...]:
    """What a schedule sends before a tick; before: what was sent before it begins.

    Where its next pulse goes the other way, DIR may have been turned for that: it is not known how
    it stands.
    """
    found = []
    for k, axis in enumerate(schedule.axes):
        n = int(np.searchsorted(axis.ticks, tick))
        earlier = before[k].last if before else None
        found.append(
            SentPulses(axis.start + int(axis.direction[:n].sum()), _last(axis, n, tick, earlier))
        )
    return tuple(found)


def _last(axis: AxisPulses, n: int, tick: int, earlier: GivenPulse | None) -> GivenPulse | None:
    """The pulse before the n-th; earlier: the one before the first."""
    if n:
        at, direction = int(axis.ticks[n - 1]) - tick, int(axis.direction[n - 1])
        last = GivenPulse(at, at, at, direction)
    elif earlier is not None:
        at = earlier.tick - tick
        last = replace(earlier, due=at, tick=at, earliest=at)
    else:
        return None
    turns = n < len(axis) and int(axis.direction[n]) != last.direction
    return replace(last, stands=last.stands and not turns)


def go_on(k: int, fired: AxisPulses, sent: int, gaps: LeastGaps, travel: Travel) -> AxisPulses:
    """The pulses of axis k behind a count that was sent, where pulses were moved across the start.

    One that was to come before it is due at once. One that came early is not sent again, if it is
    due that soon. The bound is wider by what the count is off until then. Raises MotionError where
    more than one is missing.
    """
    missing = fired.start - sent
    if missing == 0:
        return fired
    if abs(missing) > 1:
        raise MotionError(
            f"axis {fired.name}: {sent} counts were sent where the motion that goes on begins at {fired.start}; choose "
            "another instant, or plan with a rule that follows the motion from any count (nearest, floor or timer)"
        )
    if len(fired) and fired.direction[0] == -missing and fired.ticks[0] <= gaps.back:
        due, ticks, direction = 0, fired.ticks[1:], fired.direction[1:]
    else:
        due = int(fired.ticks[0]) % gaps.grain if len(fired) else 0
        ticks = np.concatenate([[due], fired.ticks])
        direction = np.concatenate([[missing], fired.direction])
    off = abs(travel(k, [0, due])[0] - fired.home / fired.pulse - sent).max()
    return replace(
        fired, ticks=ticks, direction=direction, start=sent, bound=max(fired.bound, float(off))
    )
