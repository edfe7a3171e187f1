"""Where an axis is in its play: the turns that it makes, and the steps in which its motor crosses
the play at them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from planner.pulses.generation.pieces import Stretches

# Share of a pulse within which an axis rests.
REST_PULSES = 1e-4


Turn = tuple[float, float, float]
"""When an axis comes to a turn and when it leaves it, in s, and which way: +1 or -1."""
Step = tuple[float, float, float]
"""Of a motor across the play: start and time in s, and way in m or rad."""


@dataclass(frozen=True, slots=True)
class TurnSearch:
    """How far the turns of an axis are known: it runs one way from an extreme, or is on its way
    back from there.

    Runs back by less than half a pulse turn nothing. Before its first move an axis has come from
    where `pushed` says.

    way       it was going last, +1 or -1
    extreme   m or rad, the farthest that way; reached, left: s, when it came there and when it left
    leaving   it has left by more than noise; gone: by more than REST_PULSES
    farthest  m or rad that it has run back; unturned: the most that turned nothing
    """

    way: float
    extreme: float
    reached: float
    left: float
    leaving: bool = False
    gone: bool = False
    farthest: float = 0.0
    unturned: float = 0.0

    def find(
        self, stretches: Stretches, axis: Axis, noise: float, since: float
    ) -> "tuple[list[Turn], TurnSearch]":
        """The turns on stretches that begin at a time (s) or later, and how far those behind them
        are known.

        noise: m or rad that is none of the motion. Where stretches are cut makes no difference.
        """
        pulse, ends, start = axis.pulse, stretches.ends, stretches.start
        stop = start + stretches.length
        turns: list[Turn] = []
        way, extreme, reached, left = self.way, self.extreme, self.reached, self.left
        leaving, gone, farthest, unturned = self.leaving, self.gone, self.farthest, self.unturned
        moving = np.flatnonzero(np.diff(ends))
        for k in moving[start[moving] >= since].tolist():
            x = float(ends[k + 1])
            if (x - extreme) * way > 0:
                if leaving or (x - extreme) * way > noise:
                    reached, leaving, gone = float(stop[k]), False, False
                extreme, unturned, farthest = x, max(unturned, farthest), 0.0
                continue
            back = (extreme - x) * way
            if not leaving and back > noise:
                left, leaving = max(reached, float(start[k])), True
            gone = gone or back > REST_PULSES * pulse
            farthest = max(farthest, back)
            if back >= pulse / 2:
                way = -way
                turns.append((reached, left, way))
                extreme, reached, leaving, gone, farthest = x, float(stop[k]), False, False, 0.0
        return turns, TurnSearch(way, extreme, reached, left, leaving, gone, farthest, unturned)

    def shift(self, time: float) -> "TurnSearch":
        """The same where the clock begins later by a time (s)."""
        return replace(self, reached=self.reached - time, left=self.left - time)


@dataclass(frozen=True, slots=True)
class Play:
    """Where an axis is in its play at the seam of two parts of a motion; times (s) count from
    there.

    search   its turns
    waiting  turns whose step is not known yet: more time behind them might make it longer
    left     when it left the last turn before these; None: there was none
    steps    that are not over: start, time (s) and way (m or rad); taken: the way of those before
    """

    search: TurnSearch
    waiting: tuple[Turn, ...] = ()
    left: float | None = None
    steps: tuple[Step, ...] = ()
    taken: float = 0.0

    @classmethod
    def begin(cls, axis: Axis, q: float) -> "Play":
        """Before its first move, at q (m or rad from home)."""
        return cls(TurnSearch(float(f"{axis.pushed}1"), q, 0.0, 0.0))

    def shift(self, time: float) -> "Play":
        """The same where the clock begins later by a time (s): steps that are over by then are only
        counted.
        """
        over = [step for step in self.steps if step[0] + step[1] <= time]
        return Play(
            self.search.shift(time),
            tuple((arrives - time, leaves - time, way) for arrives, leaves, way in self.waiting),
            None if self.left is None else self.left - time,
            tuple(
                (start - time, span, way) for start, span, way in self.steps if start + span > time
            ),
            self.taken + sum(way for *_, way in over),
        )

    def leave(
        self,
        t: float,
        name: str,
        steps: Sequence[Step],
        turns: Sequence[Turn],
        known: int,
        search: TurnSearch,
        x: float,
    ) -> "Play":
        """Where the axis `name` is in its play at a time t (s), at x (m or rad from home), for
        another motion.

        Of the motion that it leaves: all steps, those of this play first, and all turns found, of
        which `known` are found before t; the search there. Raises MotionError where a step has
        begun before the axis comes to its turn.
        """
        turns = [*self.waiting, *turns]
        own = steps[len(self.steps) :]
        left, waiting = self.left, []
        for j, ((start, *_), (arrives, leaves, way)) in enumerate(zip(own, turns, strict=True)):
            found = j < len(self.waiting) + known
            if start >= t:
                waiting += [(arrives, leaves, way)] if found else []
                continue
            left = leaves
            if found:
                continue
            if t < arrives:
                raise MotionError(
                    f"axis {name} is about to turn, and its motor crosses the play already: choose an instant "
                    f"{arrives - t:.6f} s later or {t - start:.6f} s earlier"
                )
            search = TurnSearch(way, x, t, t, unturned=search.unturned)
        begun = tuple(step for step in steps if step[0] < t)
        return replace(self, search=search, waiting=tuple(waiting), left=left, steps=begun).shift(t)

    def list_steps(self) -> Array:
        """(R, 3) the steps, with one before all others for the way of those that are over."""
        steps = np.array(self.steps, float).reshape(-1, 3)
        before = min(0.0, *steps[:, 0]) if len(steps) else 0.0
        return (
            steps if self.taken == 0 else np.concatenate(([[before - 2.0, 1.0, self.taken]], steps))
        )
