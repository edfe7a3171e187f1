"""Speeds at a run's ends that no motion can have."""

from kinematics.errors import MotionError


class TooFast(MotionError):
    """A run's start or end speed ṡ for which the limits leave no room; largest: what can be.

    Solvers raise it; whoever knows the path says where that is.
    """

    def __init__(self, end: int, speed: float, largest: float) -> None:
        self.end, self.speed, self.largest = end, speed, largest
        super().__init__(
            f"the {self.name} {speed:.6g} is beyond {largest:.6g}, the largest from which the run can be made"
        )

    @property
    def name(self) -> str:
        return ("start speed", "end speed")[self.end]
