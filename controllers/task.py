"""What a rig is asked to do: a motion, and how often the host commands."""

from __future__ import annotations

from dataclasses import dataclass

from planner.pulses.motion import Motion


@dataclass(frozen=True, slots=True)
class Task:
    """A motion to be tracked.

    motion  axis positions over time; where it is a `Trajectory` on a machine's path, errors in space are known too
    dt      s between the host's commands
    """

    name: str
    motion: Motion
    dt: float
