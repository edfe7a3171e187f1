"""The independent check of a pulse schedule against the motion it stands for.

It shares no code with the generator.
"""

from planner.pulses.checking.check import check, check_motion_parts, check_parts

__all__ = ["check", "check_motion_parts", "check_parts"]
