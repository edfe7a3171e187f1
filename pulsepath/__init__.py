"""The fastest motion a machine can make along a path, proved to respect every limit, as exact pulse times.

    import pulsepath as pp

    plan = pp.plan(pp.load_program("circle"), pp.load_machine("hexapod"))
    print(plan.trajectory.duration, plan.certificate)

Names load when they are first used, so that importing this package costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from benchmarks.report import write_report
    from controllers import Metrics, Tracking, evaluate, find_law, law_names, track
    from kinematics import (
        Arm,
        Axis,
        Calibration,
        FileError,
        Hexapod,
        Linkage,
        Machine,
        Measurements,
        MotionError,
        OutOfReach,
        Pose,
        Traverser,
        Tripod,
        Workspace,
        calibrate,
        load_machine,
        load_measurements,
        machine_names,
        workspace,
    )
    from planner import (
        Arc,
        Blend,
        Certificate,
        Classical,
        Dwell,
        Infeasible,
        Line,
        Place,
        Plan,
        Program,
        PulseSchedule,
        Solution,
        Standing,
        Stop,
        Trajectory,
        Turn,
        check,
        classical,
        load_program,
        plan,
        plan_many,
        program_names,
        time_optimal,
    )

__all__ = [
    "Arc",
    "Arm",
    "Axis",
    "Blend",
    "Calibration",
    "Certificate",
    "Classical",
    "Dwell",
    "FileError",
    "Hexapod",
    "Infeasible",
    "Line",
    "Linkage",
    "Machine",
    "Measurements",
    "Metrics",
    "MotionError",
    "OutOfReach",
    "Place",
    "Plan",
    "Pose",
    "Program",
    "PulseSchedule",
    "Solution",
    "Standing",
    "Stop",
    "Tracking",
    "Trajectory",
    "Traverser",
    "Tripod",
    "Turn",
    "Workspace",
    "calibrate",
    "check",
    "classical",
    "evaluate",
    "find_law",
    "law_names",
    "load_machine",
    "load_measurements",
    "load_program",
    "machine_names",
    "plan",
    "plan_many",
    "program_names",
    "time_optimal",
    "track",
    "workspace",
    "write_report",
]

_FLOORS = ("kinematics", "planner", "controllers", "benchmarks.report")


def __getattr__(name: str) -> Any:
    """A public name from the lowest floor that has it [PEP 562]; kept here from then on."""
    if name in __all__:
        for floor in map(import_module, _FLOORS):
            if hasattr(floor, name):
                globals()[name] = value = getattr(floor, name)
                return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
