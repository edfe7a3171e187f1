"""What a kind of machine states: its inverse map as one expression, and what else only it knows."""

from abc import ABC, abstractmethod
from typing import ClassVar

import casadi as ca

from kinematics.array import Array, frozen
from kinematics.body import Body
from kinematics.clearance import Bodies
from kinematics.freedom import COMPONENTS
from kinematics.load import Load
from kinematics.pose import column
from kinematics.skeleton import Skeleton


def side(x: ca.SX) -> ca.SX:
    """1 or −1, never 0: the sign by which `near` chooses."""
    return ca.sign(2 * ca.sign(x) + 1)


class Kind(ABC):
    """What `kinematics.machine.Machine` asks of its kind.

    It states its map from pose to actuator coordinates once, symbolically, in `expression`; numeric
    evaluation, Jacobian, path derivatives, guaranteed enclosures and optimisation all come from that.

    freedom   which of x y z rx ry rz it controls, as many as it has axes
    follows   which go along with them: ignored by the inverse map, filled in by `forward`; all others are held at home
    branched  whether a pose has several coordinates (turns, elbows), among which `near` chooses
    lengths   whether coordinates are distances: none is below 0, and not all belong to a pose
    sorts     "linear" or "rotary" of each axis; empty: whichever it is
    """

    freedom: ClassVar[tuple[str, ...]] = COMPONENTS
    follows: ClassVar[tuple[str, ...]] = ()
    branched: ClassVar[bool] = False
    lengths: ClassVar[bool] = False
    sorts: ClassVar[tuple[str, ...]] = ()
    legs: ClassVar[int] = 0
    characteristic_length: float
    """m that count as one radian where lengths and angles meet, as in the path parameter of a pure turn."""

    load: Load
    """What it carries: its platform's masses, tool and wrench."""

    @abstractmethod
    def expression(self, position: ca.SX, rotation: ca.SX, near: ca.SX) -> ca.SX:
        """Actuator coordinates (n,) at position (3) and rotation (3, 3) of the platform frame in the base frame.

        near (n,) chooses where `branched`; others ignore it.
        """

    def carried(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        """The pose with what `follows` filled in from the coordinates."""
        return position, rotation

    def alternatives(self, near: Array) -> list[Array]:
        """Coordinates near which a pose's are looked for, in turn, where there are none near (n,)."""
        return []

    def tilts(self, position: ca.SX, rotation: ca.SX) -> ca.SX:
        """Cosine of each joint's angle from its rest axis (m,); none by default."""
        return ca.SX(0, 1)

    tilt_names: tuple[str, ...] = ()
    max_tilt: Array = frozen([])
    """(m,) rad, one per joint of `tilts`."""

    bodies: Bodies | None = None
    """What takes up room, so that its clearance can be measured; nothing by default."""

    def moved(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> tuple[tuple[Body, ca.SX], ...]:
        """The bodies that move, the platform first, each with the twelve numbers of its frame.

        The pose has what follows filled in; q belongs to it.
        """
        return ((self.load.platform, column(*self.carried(position, rotation, q))),)

    def skeleton(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> Skeleton:
        """Bars and pivots to draw, at a pose with what follows filled in and the coordinates that belong to it.

        Nothing by default: the machine is then shown by its tool alone.
        """
        return Skeleton()
