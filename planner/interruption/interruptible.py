"""What a certified motion can be asked for besides running through: a stop, the way on, less speed; and its export."""

from abc import ABC, abstractmethod
from os import PathLike
from typing import Annotated, Any

from kinematics.foundation.options import check_arguments
from kinematics.foundation.units import Unit
from planner.export.format import Exported, ExportSource, write_export
from planner.interruption.hold import Stops, find_stops, hold
from planner.interruption.override import override, resume
from planner.interruption.section import Section, Whole


class Interruptible(ABC):
    """A plan, fresh or loaded. `Section`s, which `hold`, `resume` and `override` give, run through to their rest."""

    __slots__ = ()

    @abstractmethod
    def whole(self) -> Whole:
        """What sections of it are made of."""

    @check_arguments()
    def hold(self, at: Annotated[float, Unit("s")], during: Section | None = None) -> Section:
        """Compute the soonest certified stop along the path from an instant `at` (s); its pulses continue the plan's.

        At a rest the stop is empty: it takes no time, goes no way and has no pulses.

        during: a section that runs instead of the plan, as one that `override` gave; `at` counts from its start.

        Raises MotionError for an instant outside the motion (`planner.interruption.hold`).
        """
        return hold(self.whole(), at, during)

    @check_arguments()
    def resume(self, stop: Section | Annotated[float, Unit("m")], share: float | None = None) -> Section:
        """The motion from a stop, or from rest at a place (m of the path), to the end.

        share: of the plan's speed, which is taken up as soon as the limits allow. None: the fastest motion, or the
        speed of a plan with a stated duration or another objective than time.
        """
        return resume(self.whole(), stop, share)

    @check_arguments()
    def override(
        self, share: float, at: Annotated[float, Unit("s")] | None = None, during: Section | None = None
    ) -> Section:
        """The motion at a share of the plan's speed, above 0 and up to 1, certified, with pulses.

        at: from this instant (s) on, the change of speed as soon as the limits allow; None: all of it from the start.
        during: a section that runs instead of the plan, slowed or about to stop; `at` counts from its start.

        Raises MotionError where no such motion keeps every limit (`planner.interruption.override`).
        """
        return override(self.whole(), share, at, during)

    @check_arguments()
    def stops(self, count: int = 50) -> Stops:
        """How soon and how far it comes to rest, if held, from each of `count` instants."""
        return find_stops(self.whole(), count)

    @check_arguments()
    def export(self, format: str, path: str | PathLike[str], *, force: bool = False, **options: Any) -> Exported:
        """Write it in a format of `planner.export.format`, and tell how far what the file holds is from the plan.

        options: the fields of the format's dataclass, in SI units. force: replace a file that is there.
        Raises MotionError for an unknown format or option, a file that is there, and what the format cannot hold.
        """
        whole = self.whole()
        source = ExportSource(whole.name, whole.machine, whole.trajectory, whole.pulses, triggers=whole.triggers)
        return write_export(source, format, path, force, options)
