"""What a machine is: its inverse map as one expression, and everything that follows from it."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from functools import cached_property
from typing import ClassVar, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import Array, frozen
from kinematics.axis import Axis
from kinematics.body import Body
from kinematics.clearance import Bodies
from kinematics.errors import MotionError, OutOfReach
from kinematics.expression import Expression
from kinematics.forward import Forward, solve
from kinematics.freedom import COMPONENTS, refuse
from kinematics.load import Load
from kinematics.margins import Margins, measure
from kinematics.pose import Pose, column, numbers, symbols
from kinematics.rates import rates
from kinematics.regular import cell_map
from kinematics.virtual_work import Balance, force_map, holding_map, loaded


class Machine(ABC):
    """A machine of n axes that carries a platform (or tool).

    A kind of machine states its map from pose to actuator coordinates once, symbolically, in `expression`; numeric
    evaluation, Jacobian, path derivatives, guaranteed enclosures and optimisation all come from that.

    freedom   which of x y z rx ry rz it controls, as many as it has axes
    follows   which go along with them: ignored by the inverse map, filled in by `forward`; all others are held at home
    branched  whether a pose has several coordinates (turns, elbows), among which `near` chooses
    """

    freedom: ClassVar[tuple[str, ...]] = COMPONENTS
    follows: ClassVar[tuple[str, ...]] = ()
    branched: ClassVar[bool] = False
    legs: ClassVar[int] = 0
    characteristic_length: float
    """m that count as one radian where lengths and angles meet, as in the path parameter of a pure turn."""

    def __init__(
        self,
        name: str,
        axes: Sequence[Axis],
        home: Pose,
        near: ArrayLike | None = None,
        load: Load | None = None,
    ) -> None:
        """near (n,): which of the home pose's coordinates are meant, where there are several (zeros by default)."""
        self.name, self.axes, self.home = name, tuple(axes), home
        if len(self.axes) != len(self.freedom):
            raise MotionError(f"machine {name}: {len(self.axes)} axes for {len(self.freedom)} freedoms {self.freedom}")
        if not home.single:
            raise MotionError(f"machine {name}: home must be one pose, not {len(home)}; index the one that is meant")
        if len({axis.name for axis in self.axes}) < len(self.axes):
            raise MotionError(
                f"machine {name}: two axes have the same name; names tell the limits of one from another's"
            )
        self.load = self._bearing(Load() if load is None else load)
        self.home_q: Array = frozen(self.inverse(home, np.zeros(len(self.axes)) if near is None else near))

    @abstractmethod
    def expression(self, position: ca.SX, rotation: ca.SX, near: ca.SX) -> ca.SX:
        """Actuator coordinates (n,) at position (3) and rotation (3, 3) of the platform frame in the base frame.

        near (n,) chooses where `branched`; others ignore it.
        """

    def carried(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        """The pose with what `follows` filled in from the coordinates."""
        return position, rotation

    def tilts(self, position: ca.SX, rotation: ca.SX) -> ca.SX:
        """Cosine of each joint's angle from its rest axis (m,); none by default."""
        return ca.SX(0, 1)

    tilt_names: tuple[str, ...] = ()
    max_tilt: Array = frozen([])
    """(m,) rad, one per joint of `tilts`."""

    bodies: Bodies | None = None
    """What takes up room, so that its clearance can be measured; nothing by default."""

    def carrying(self, load: Load) -> Self:
        """The same machine with another load."""
        other = copy(self)
        other.load = self._bearing(load)
        for of_load in ("force_map", "holding_map", "loaded"):
            other.__dict__.pop(of_load, None)
        return other

    def _bearing(self, load: Load) -> Load:
        """A load that fits the machine. Raises MotionError for legs that it has not."""
        if load.legs and self.legs == 0:
            raise MotionError(f"machine {self.name} has no legs that could have masses")
        if len(load.legs) not in (0, 1, self.legs):
            raise MotionError(
                f"machine {self.name}: {len(load.legs)} legs with masses; give one for all, or {self.legs}"
            )
        return load

    def moved(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> tuple[tuple[Body, ca.SX], ...]:
        """The bodies that move, the platform first, each with the twelve numbers of its frame.

        The pose has what follows filled in; q belongs to it.
        """
        return ((self.load.platform, column(*self.carried(position, rotation, q))),)

    def symbolic(self, x: ca.SX, near: ca.SX) -> ca.SX:
        """Coordinates (n,) of pose numbers (12), to be composed with whatever they depend on."""
        return self.expression(*symbols(x), near)

    @cached_property
    def inverse_map(self) -> Expression:
        """Pose numbers (12), and near (n) where branched -> q (n)."""
        x, near = self._symbols()
        return Expression("inverse", self._inputs(x, near), self.symbolic(x, near))

    @cached_property
    def jacobian_map(self) -> Expression:
        """The same -> J (n, 6) row by row, as in `jacobian`."""
        (x, near), twist = self._symbols(), ca.SX.sym("twist", 6)
        position, rotation = symbols(x)
        moved = self.expression(position + twist[:3], rotation + ca.skew(twist[3:]) @ rotation, near)
        jacobian = ca.substitute(ca.jacobian(moved, twist), twist, ca.SX.zeros(6))
        return Expression("jacobian", self._inputs(x, near), ca.vec(jacobian.T))

    @cached_property
    def carried_map(self) -> Expression:
        """The same -> pose numbers (12) with what follows filled in."""
        x, near = self._symbols()
        return Expression("carried", self._inputs(x, near), column(*self.carried(*symbols(x), self.symbolic(x, near))))

    @cached_property
    def tilt_map(self) -> Expression:
        """Pose numbers (12) -> cosines of the joints' tilts (m)."""
        x = ca.SX.sym("x", 12)
        return Expression("tilts", x, self.tilts(*symbols(x)))

    @cached_property
    def rates_map(self) -> Expression:
        """The same, a twist (6) and its rate (6) -> q̇ (n), q̈ (n), and twist and rate (6, 6) of what is carried."""
        x, near = self._symbols()
        return rates(self, x, near, self._inputs(x, near))

    @cached_property
    def force_map(self) -> Balance:
        """x, ẋ, ẍ (12 each), q, q̇, q̈ (n each) -> actuator forces (n): see `kinematics.virtual_work`."""
        return force_map(self)

    @cached_property
    def holding_map(self) -> Balance:
        """x (12), q (n) -> the forces (n) that hold the machine still."""
        return holding_map(self)

    @cached_property
    def loaded(self) -> bool:
        """Whether it states masses, friction or a wrench: without any, its actuators have nothing to push."""
        return loaded(self)

    @cached_property
    def cell_map(self) -> Expression:
        """What the proof of `forward` bounds over one cell of a straight motion: see `kinematics.regular`."""
        return cell_map(self)

    def _symbols(self) -> tuple[ca.SX, ca.SX]:
        return ca.SX.sym("x", 12), ca.SX.sym("near", len(self.axes))

    def _inputs(self, x: ca.SX, near: ca.SX) -> ca.SX:
        return ca.vertcat(x, near) if self.branched else x

    def inputs(self, x: Array, near: Array) -> Array:
        """What the maps take: pose numbers (N, 12), and near (n,) or (N, n) beside them where branched."""
        if not self.branched:
            return x
        return np.concatenate([x, np.broadcast_to(near, (len(x), len(self.axes)))], 1)

    def inverse(self, pose: Pose, near: ArrayLike | None = None) -> Array:
        """Actuator coordinates q (N, n) of N poses, (n,) of one.

        near (n,) picks branch and turn where there are several (home's by default). Raises OutOfReach where no solution
        exists: too far, or off the machine's freedom.
        """
        x = numbers(pose)
        refuse(self, x)
        q = self.inverse_map(self.inputs(x, self._near(near)))
        lost = ~np.isfinite(q).all(1)
        if lost.any():
            first = int(np.argmax(lost))
            where = np.atleast_2d(pose.translation)[first]
            raise OutOfReach(
                f"machine {self.name}: no actuator coordinates reach pose {first}, "
                f"position {where * 1e3} mm; bring it nearer"
            )
        return q[0] if pose.single else q

    def jacobian(self, pose: Pose, near: ArrayLike | None = None) -> Array:
        """J (N, n, 6) of N poses, (n, 6) of one: dq = J [dx, dy, dz, wx, wy, wz] in the base frame.

        The velocity is that of the platform's origin, the reference point. near as in `inverse`.
        """
        j = self.jacobian_map(self.inputs(numbers(pose), self._near(near))).reshape(-1, len(self.axes), 6)
        return j[0] if pose.single else j

    def _near(self, near: ArrayLike | None) -> Array:
        if near is None:
            return self.home_q
        chosen = np.asarray(near, float)
        if chosen.shape != (len(self.axes),) or not np.isfinite(chosen).all():
            raise MotionError(f"machine {self.name}: near must be {len(self.axes)} finite coordinates, not {near}")
        return chosen

    def start(self, q: Array, near: Array) -> Array:
        """Pose numbers (N, 12) from which `forward` looks for coordinates q (N, n), asked from near (N, 12)."""
        return near

    def forward(self, q: ArrayLike, near: Pose | None = None, *, certify: bool = True) -> Forward:
        """The pose of actuator coordinates q (N, n) or (n,), by Newton on SE(3) from `near` (home by default).

        certify=False leaves the proof out, which takes most of the time: nothing is certified then.
        """
        return solve(self, np.asarray(q, float), self.home if near is None else near, certify)

    def check(self, pose: Pose) -> Margins:
        """Travel, tilt and clearance against their limits, conditioning, and distance to the nearest singularity."""
        return measure(self, pose)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}: {len(self.axes)} axes>"
