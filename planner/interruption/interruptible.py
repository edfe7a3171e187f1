"""The methods of a plan, fresh or loaded, that stop and resume its motion and export it."""

from abc import ABC, abstractmethod
from os import PathLike
from typing import Annotated, Any

from kinematics.foundation.options import check_arguments
from kinematics.foundation.units import Unit
from planner.export.format import Exported, ExportSource, write_export
from planner.interruption.hold import Stops, find_stops, hold
from planner.interruption.resume import resume
from planner.interruption.section import Section, Whole


class Interruptible(ABC):
    """A plan, fresh or loaded. `hold` and `resume` give a `Section`, which runs to its own rest."""

    __slots__ = ()

    @abstractmethod
    def whole(self) -> Whole:
        """Return the parts of the plan that its sections are made from."""

    @check_arguments()
    def hold(self, at: Annotated[float, Unit("s")], during: Section | None = None) -> Section:
        """Compute the soonest certified stop along the path from an instant `at` (s).

        Its pulses continue the plan's. At a rest the stop is empty: it takes no time, goes no way
        and has no pulses.

        during: a section that runs instead of the plan, as one that `resume` gave; `at` counts from
        its start.

        Raises MotionError for an instant outside the motion (`planner.interruption.hold`).
        """
        return hold(self.whole(), at, during)

    @check_arguments()
    def resume(
        self,
        stop: Section | Annotated[float, Unit("m")],
        share: float | None = None,
    ) -> Section:
        """Compute the certified motion to the end from a stop, or from rest at a place (m).

        share: of the plan's speed, above 0 and up to 1, which is taken up as soon as the limits
        allow. None: the fastest motion, or the speed of a plan with a stated duration or another
        objective than time. `resume(0.0, share)` is the whole plan at that share of its speed.

        Raises MotionError for a place outside the path, for a share out of range, and where no such
        motion keeps every limit (`planner.interruption.resume`).
        """
        return resume(self.whole(), stop, share)

    @check_arguments()
    def stops(self, count: int = 50) -> Stops:
        """Compute time and distance to rest from instants of `count` equal intervals of time."""
        return find_stops(self.whole(), count)

    @check_arguments()
    def export(
        self,
        format: str,
        path: str | PathLike[str],
        *,
        force: bool = False,
        **options: Any,
    ) -> Exported:
        """Write the plan in an export format; return how far the file is from the plan.

        options: the fields of the format's dataclass, in SI units. force: replace an existing file.

        Raises MotionError for an unknown format or option, an existing file, and a motion that the
        format cannot hold.
        """
        whole = self.whole()
        source = ExportSource(
            whole.name,
            whole.machine,
            whole.trajectory,
            whole.pulses,
            triggers=whole.triggers,
        )
        return write_export(source, format, path, force, options)
