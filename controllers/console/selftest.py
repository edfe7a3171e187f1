"""The self-test: every axis end to end on the card alone, its pulses counted one by one; the machine does not move."""

from __future__ import annotations

import numpy as np

from controllers.console.motion import to
from controllers.console.session import Session

LONGEST = 200_000
"""Steps that an axis is tested over at most: an endless one would count for weeks."""


def report(session: Session) -> str:
    """A line about each axis: steps over its travel, their rate at most, its ramp, the time, and whether all fired."""
    drives, lines = session.drives, ["TEST: commands are checked and not run; MAN goes back"]
    for i, (name, axis) in enumerate(zip(drives.names, session.machine.axes, strict=True)):
        steps = int(min(drives.high[i] - drives.low[i], LONGEST))
        target = np.zeros(len(drives.names), np.int64)
        target[i] = steps
        motion = to(drives, np.zeros_like(target), target, drives.speed, 0.0)
        fired = int(motion.fired(0.0, np.inf)[i].sum())
        verdict = "OK" if fired == steps == motion.counts(np.inf)[i] else f"FAULT: {fired} pulses fired"
        rate = f"{drives.speed[i]:.6g} steps/s at most after a ramp of {drives.ramp[i]:.0f}"
        lines.append(f"{name}: {steps} steps of {axis.pulse:.6g} {axis.unit}, {rate}, {motion.end:.3f} s: {verdict}")
    return "\n".join(lines)
