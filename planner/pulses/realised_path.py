"""How far the path that pulses make is from the planned one: what `planner.pulses.realised` finds."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from kinematics.result import Result
from kinematics.table import Column, Table
from planner.place import Place, where_columns

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class RealisedError:
    """One error of the realised path: realised - planned, a component in the base frame or a distance in space.

    rms         √(1/T ∫ e² dt), the error taken as linear between the instants looked at, window by window
    max, where  the largest magnitude and its place
    bound       of the magnitude, the largest along the path: Σⱼ |J⁻¹ᵢⱼ| bⱼ of a component, max ‖J⁻¹ b‖ over the signs
                of the bⱼ in space; bⱼ, in m or rad, is the schedule's bound and one tick's travel of axis j through
                its screw, and its play and lead error, or what is left of them where they are made up for
    series, bounds  (W,) the same in windows of time: largest magnitude, and largest bound at the windows' two ends
    """

    name: str
    unit: str
    rms: float
    max: float
    where: Place
    bound: float
    series: Array = field(repr=False)
    bounds: Array = field(repr=False)

    @property
    def share(self) -> float:
        """The largest share of the bound that any window's error takes."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return float(np.nanmax(np.where(self.bounds > 0, self.series / self.bounds, 0.0), initial=0.0))


@dataclass(frozen=True, slots=True)
class RealisedPath(Result):
    """How far the pose to which the integer counts lead the machine is from the planned pose.

    rule      of firing that made the pulses
    instants  how many were looked at, each just after a pulse and just before the next
    stride    1: all of them; k: every k-th
    edges     (W+1,) s, the ends of the windows of the errors' series
    errors    of each component that moves, then in space ("position") and of the whole turn ("orientation")
    mover     "platform" or "tool": whose pose it is
    mechanics of each axis that states play or lead error, in words: both are simulated, and in the bound
    """

    machine: str
    rule: str
    mover: str
    instants: int
    stride: int
    edges: Array = field(repr=False)
    errors: tuple[RealisedError, ...]
    mechanics: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> RealisedError:
        """The error of a name. Raises MotionError for another one."""
        for error in self.errors:
            if error.name == name:
                return error
        known = ", ".join(error.name for error in self.errors)
        raise MotionError(f"the realised path has no error {name!r}; it has {known}")

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """The error in space over time and its bound; planner.plots.realised_error has the other errors."""
        from planner.plots import realised_error

        ax = realised_error(self, ax=ax)
        ax.legend(frameon=False, loc="lower center")
        return ax

    def tables(self) -> tuple[Table, ...]:
        """Each error, its bound, and where it is largest."""
        every = "each" if self.stride == 1 else f"one in {self.stride}"
        title = (
            f"realised path of the {self.mover} of {self.machine}, rule {self.rule}: {self.instants} instants, "
            f"{every} just after and just before a pulse"
        )
        units = [error.unit for error in self.errors]
        figures = (("RMS", "rms"), ("largest", "max"), ("bound", "bound"))
        columns = (
            Column("error", [error.name for error in self.errors]),
            *(
                Column(
                    name, [getattr(error, field) for error in self.errors], units, "micro", ".4f", up=field == "bound"
                )
                for name, field in figures
            ),
            Column("of bound", [error.share for error in self.errors], form=".3f"),
            *where_columns([error.where for error in self.errors]),
        )
        return (Table(title, columns, tuple(f"in error and bound, {text}" for text in self.mechanics)),)

    def data(self) -> Table:
        """The largest of each error in windows of time, and its bound."""
        ends = (Column("from", self.edges[:-1], "s"), Column("to", self.edges[1:], "s"))
        series = (
            Column(f"{error.name}{of}", values, error.unit)
            for error in self.errors
            for of, values in (("", error.series), (" bound", error.bounds))
        )
        return Table(f"realised path of {self.machine}", (*ends, *series))
