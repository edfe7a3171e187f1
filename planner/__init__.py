"""Program -> path -> limits -> time-optimal trajectory -> certificate -> pulses -> export."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from planner.baselines import Classical, classical
from planner.certificate.certify import Certificate
from planner.certificate.feasibility import Standing
from planner.cluster import plan_many
from planner.orientation.orient import orient
from planner.place import Infeasible, Place
from planner.plan import Plan, check, plan
from planner.program.model import Arc, Curve, Dwell, Line, Program, Spline, Synchronised, Turn
from planner.program.modifiers import Blend, Free, Stop, Through, Trigger
from planner.program.synchronise import synchronise
from planner.pulses import PulseSchedule, RealisedPath, realised
from planner.sources.position_list import PositionList
from planner.time_optimal import time_optimal
from planner.timing.certified_solve import Solution
from planner.trajectory import State, Trajectory
from planner.triggers import Triggered

if TYPE_CHECKING:
    from planner.sources.arm_simulation import ArmSimulation
    from planner.sources.source import Imported

__all__ = [
    "Arc", "Blend", "Certificate", "Classical", "Curve", "Dwell", "Free", "Infeasible", "Line", "Place", "Plan",
    "PositionList", "Program", "PulseSchedule", "RealisedPath", "Solution", "Spline", "Standing", "State", "Stop",
    "Synchronised", "Through", "Trajectory", "Trigger", "Triggered", "Turn", "check", "classical", "import_program",
    "load_positions", "load_program", "orient", "plan", "plan_many", "program_names", "realised", "save_positions",
    "simulate_arms", "synchronise", "time_optimal",
]  # fmt: skip


def load_program(name_or_path: Any) -> Program:
    """The program of a preset's name or of a TOML file."""
    from planner.program.program_file import load_program

    return load_program(name_or_path)


def import_program(path: Any, format: str | None = None, **options: Any) -> "Imported":
    """The program in a file of another format, by its suffix or the format's name, and what was understood of it."""
    from planner.sources.source import import_program

    return import_program(path, format, **options)


def load_positions(path: Any, **options: Any) -> PositionList:
    """The poses in a CSV file, or in one of the three-armed machine; options as `import_program` has them."""
    from planner.sources.positions import Positions

    return Positions(**options).load(Path(path))[0]


def save_positions(listed: PositionList, path: Any) -> None:
    """Write a list as CSV, whole or not at all."""
    from planner.sources.position_list import save_positions

    save_positions(listed, Path(path))


def simulate_arms(listed: PositionList, machine: Any, *, unit: float | None = None) -> "ArmSimulation":
    """The lengths of three arms at a list's poses, turned ones too, which are shown and never run.

    unit  m: every step of the rule of [KMITL 2005], of a unit or of 1°; None: the listed poses alone
    Raises MotionError for a machine without three arms.
    """
    from planner.sources.arm_simulation import simulate_arms

    return simulate_arms(listed, machine, unit=unit)


def program_names() -> tuple[str, ...]:
    """Names of the bundled programs."""
    from planner.program.program_file import program_names

    return program_names()
