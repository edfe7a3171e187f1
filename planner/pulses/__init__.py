"""Pulse schedules: from a motion to exact clock ticks, and the independent proof that they stand for it."""

from planner.pulses.check import check
from planner.pulses.compress import compress
from planner.pulses.file_check import check_file
from planner.pulses.generate import generate, paced
from planner.pulses.motion import Motion, MotionState
from planner.pulses.realised import realised
from planner.pulses.realised_path import RealisedError, RealisedPath
from planner.pulses.rules import RULES, Rule, find_rule
from planner.pulses.schedule import AxisPulses, Moved, PulseSchedule
from planner.pulses.step_queue import StepQueue, decompress
from planner.pulses.verdict import AxisCheck, PulseCheck, PulseFault

__all__ = [
    "RULES",
    "AxisCheck",
    "AxisPulses",
    "Motion",
    "MotionState",
    "Moved",
    "PulseCheck",
    "PulseFault",
    "PulseSchedule",
    "RealisedError",
    "RealisedPath",
    "Rule",
    "StepQueue",
    "check",
    "check_file",
    "compress",
    "decompress",
    "find_rule",
    "generate",
    "paced",
    "realised",
]
