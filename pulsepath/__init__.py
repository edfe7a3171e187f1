"""The fastest motion a machine can make along a path, proved to respect every limit, as exact pulse
times.

    import pulsepath as pp

    plan = pp.plan("circle", "hexapod")
    print(plan.trajectory.duration, plan.certificate)

Names load when they are first used, so that importing this package costs nothing.
"""

from importlib import import_module
from importlib.util import find_spec

__version__ = "0.1.0"


_INNER = {"Load", "State"}
"""Names of the packages below that results hand out: they are found here, and not listed."""
_REPORTS = {
    **dict.fromkeys(("animate", "four_views", "save_four_views"), "benchmarks.animation"),
    **dict.fromkeys(("Comparison", "compare", "verdict_of"), "benchmarks.reports.gain"),
    "write_report": "benchmarks.reports.plan_report",
    "load_plan": "pulsepath.store.read",
    **dict.fromkeys(("Grid", "read_setting", "settings_of", "sweep"), "benchmarks.sweep"),
}


def __getattr__(name: str) -> object:
    """A module of this package, or a public name of the packages below [PEP 562], each of which
    loads it where it is; kept here from then on.
    """
    if find_spec(f"{__name__}.{name}") is not None:  # an import of it asks here first
        return import_module(f"{__name__}.{name}")
    import controllers
    import kinematics
    import planner

    home = {
        name: face.__name__ for face in (kinematics, planner, controllers) for name in face.__all__
    } | _REPORTS
    if name == "__all__":
        return sorted(home.keys() - _INNER)
    if name not in home:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value = getattr(import_module(home[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__getattr__("__all__"), "plots"])
