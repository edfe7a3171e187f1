"""A plan written in a format, by the format's name."""

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.destination import Destination
from kinematics.errors import MotionError
from planner.export.format import Exported, Source, export
from planner.export.formats import find_format

if TYPE_CHECKING:
    from planner.plan import Plan


def written(plan: "Plan", name: str, path: str | PathLike[str], force: bool, options: Mapping[str, Any]) -> Exported:
    """What `Plan.export` does; the file is there whole or not at all."""
    kind = find_format(name)
    try:
        format_ = kind(**options)
    except TypeError as error:
        raise MotionError(f"format {name}: {error}") from None
    target = Destination(Path(path), force=force, remedy="give force=True to replace it, or another path")
    with target.staged() as file:
        return export(format_, name, Source(plan.program.name, plan.machine, plan.trajectory, plan.pulses), file)
