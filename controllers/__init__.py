"""Emulated hardware and tracking: motion card, servo, tracking laws, simulation, error metrics."""

from os import PathLike

from controllers.laws.registry import find_law, law_names
from controllers.metrics import Metrics, evaluate
from controllers.rig import Rig
from controllers.tracking import Tracking, track

__all__ = ["Metrics", "Rig", "Tracking", "evaluate", "find_law", "law_names", "load_rig", "rig_names", "track"]


def load_rig(name_or_path: str | PathLike[str]) -> Rig:
    """The rig of a preset's name or of a TOML file."""
    from controllers.rig_file import load_rig

    return load_rig(name_or_path)


def rig_names() -> tuple[str, ...]:
    """Names of the bundled rigs."""
    from controllers.rig_file import rig_names

    return rig_names()
