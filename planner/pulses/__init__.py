"""Pulse schedules: from a motion to exact clock ticks, and the independent proof that they stand for it."""

from planner.pulses.checking import check
from planner.pulses.checking.edge_reader import check_file
from planner.pulses.checking.verdict import AxisCheck, PulseCheck, PulseFault
from planner.pulses.compression import compress
from planner.pulses.generation.generate import RULES, find_rule, generate, pace_axes
from planner.pulses.generation.rule import Rule
from planner.pulses.motion import AxesMotion, MotionState
from planner.pulses.realised_path import RealisedError, RealisedPath, realised
from planner.pulses.schedule import AxisPulses, MovedPulses, PulseSchedule
from planner.pulses.step_queue import StepQueue, decompress

__all__ = [
    "RULES",
    "AxesMotion",
    "AxisCheck",
    "AxisPulses",
    "MotionState",
    "MovedPulses",
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
    "pace_axes",
    "realised",
]
