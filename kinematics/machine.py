"""What a machine is: its inverse map as one expression, and everything that follows from it."""

from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from copy import copy
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import Array, finite, frozen
from kinematics.axis import Axis
from kinematics.body import Body
from kinematics.clearance import Bodies
from kinematics.errors import BadValue, MotionError, OutOfReach
from kinematics.expression import Expression
from kinematics.forward import Forward, solve
from kinematics.freedom import COMPONENTS, refuse
from kinematics.load import Load
from kinematics.machine_tables import axes_table
from kinematics.margins import Margins, measure
from kinematics.pose import Pose, checked, column, symbols
from kinematics.rates import rates
from kinematics.regular import cell_map
from kinematics.result import Result
from kinematics.table import Table
from kinematics.virtual_work import Balance, force_map, holding_map, loaded

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def side(x: ca.SX) -> ca.SX:
    """1 or −1, never 0: the sign by which `near` chooses."""
    return ca.sign(2 * ca.sign(x) + 1)


class Machine(Result):
    """A machine of n axes that carries a platform (or tool).

    A kind of machine states its map from pose to actuator coordinates once, symbolically, in `expression`; numeric
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

    def __init__(
        self,
        name: str,
        axes: Iterable[Axis],
        home: Pose,
        near: ArrayLike | None = None,
        load: Load | None = None,
    ) -> None:
        """near (n,): which of the home pose's coordinates are meant, where there are several (zeros by default)."""
        if not isinstance(name, str) or not name:
            raise MotionError(f"a machine needs a name, a text that is not empty, not {name!r}")
        checked(name, "home", home, single=True)
        self.name, self.axes, self.home = name, self._driven(name, axes), home
        self.load = self._bearing(Load() if load is None else load)
        self.home_q: Array = frozen(self.inverse(home, np.zeros(len(self.axes)) if near is None else near))

    def _driven(self, name: str, given: Iterable[Axis]) -> tuple[Axis, ...]:
        """As many axes as there are freedoms, each of its sort, no two with the same name or the same driver."""
        kind, count = type(self).__name__.lower(), len(self.freedom)
        axes = tuple(given) if isinstance(given, Iterable) else (given,)
        strange = [axis for axis in axes if not isinstance(axis, Axis)]
        if strange:
            raise MotionError(f"machine {name}: axes must be {count} of Axis, not {strange[0]!r:.100}")
        if len(axes) != count:
            raise MotionError(f"machine {name}: {len(axes)} axes; a {kind} has {count}, for {', '.join(self.freedom)}")
        for axis, sort in zip(axes, self.sorts, strict=False):
            if axis.kind != sort:
                raise MotionError(f"machine {name}: axis {axis.name} is {axis.kind}; a {kind} has a {sort} one there")
        if len({axis.name for axis in axes}) < count:
            raise MotionError(
                f"machine {name}: two axes have the same name; names tell the limits of one from another's"
            )
        wired = Counter((axis.card, axis.channel) for axis in axes if axis.card is not None)
        for (card, channel), times in wired.items():
            if times > 1:
                both = [axis.name for axis in axes if (axis.card, axis.channel) == (card, channel)]
                raise BadValue(
                    f"machine {name}: {' and '.join(both)} are both on channel {channel} of card {card}; "
                    "give each one of its own",
                    key=(both[-1],),
                )
        return axes

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

    def carrying(self, load: Load) -> Self:
        """The same machine with another load."""
        other = copy(self)
        other.load = self._bearing(load)
        other._forget("force_map", "holding_map", "loaded")
        return other

    def driven_by(self, axes: Iterable[Axis]) -> Self:
        """The same machine with other actuators: what each may do and how it counts; names, kinds and home stay.

        Raises MotionError for axes that are not as many, or not called as the machine's own.
        """
        other, names = copy(self), tuple(axis.name for axis in self.axes)
        other.axes = self._driven(self.name, axes)
        given = tuple(axis.name for axis in other.axes)
        if given != names:
            raise MotionError(
                f"machine {self.name}: its axes are called {', '.join(names)}, not {', '.join(given)}; keep their names"
            )
        other._forget("force_map", "loaded")
        return other

    def called(self, name: str) -> Self:
        """The same machine by another name, as of a copy of its file."""
        other = copy(self)
        other.name = name
        return other

    def _forget(self, *maps: str) -> None:
        """What a copy must not take over, since what it is made from has changed."""
        for name in maps:
            self.__dict__.pop(name, None)

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
        exists: too far, or off the machine's freedom; MotionError for what is no pose, such as a mirrored one.
        """
        q = self.located(pose, near)[1]
        return q[0] if pose.single else q

    def located(self, pose: Pose, near: ArrayLike | None = None) -> tuple[Array, Array]:
        """Numbers (N, 12) and coordinates (N, n) of the poses that a caller gives; see `inverse` for what it raises."""
        x = checked(self.name, "pose", pose)
        refuse(self, x)
        chosen = self._near(near)
        q = self.inverse_map(self.inputs(x, chosen))
        lost = self._lost(q)
        for other in self.alternatives(chosen) if lost.any() else ():
            q[lost] = self.inverse_map(self.inputs(x[lost], other))
            lost = self._lost(q)
        if lost.any():
            first = int(np.argmax(lost))
            raise OutOfReach(
                f"machine {self.name}: no actuator coordinates reach pose {first}, "
                f"position {x[first, :3] * 1e3} mm; bring it nearer"
            )
        return x, q

    def _lost(self, q: Array) -> np.ndarray:
        return np.asarray(~(np.isfinite(q) & (q >= (0.0 if self.lengths else -np.inf))).all(1))

    def jacobian(self, pose: Pose, near: ArrayLike | None = None) -> Array:
        """J (N, n, 6) of N poses, (n, 6) of one: dq = J [dx, dy, dz, wx, wy, wz] in the base frame.

        The velocity is that of the platform's origin, the reference point. near as in `inverse`. Raises what `inverse`
        does, and MotionError where coordinates have no finite rates: an arm stretched out, a leg of no length.
        """
        x, q = self.located(pose, near)
        j = self.jacobian_map(self.inputs(x, q)).reshape(-1, len(self.axes), 6)
        endless = ~np.isfinite(j).all((1, 2))
        if endless.any():
            first = int(np.argmax(endless))
            raise MotionError(
                f"machine {self.name} is singular at pose {first}, position {x[first, :3] * 1e3} mm: its coordinates "
                "have no finite rates there; keep away from it (check tells how near it is)"
            )
        return j[0] if pose.single else j

    def _near(self, near: ArrayLike | None) -> Array:
        if near is None:
            return self.home_q
        return finite(near, f"machine {self.name}: near", (len(self.axes),))

    def start(self, q: Array, near: Array) -> Array:
        """Pose numbers (N, 12) from which `forward` looks for coordinates q (N, n), asked from near (N, 12)."""
        return near

    def forward(self, q: ArrayLike, near: Pose | None = None, *, certify: bool = True) -> Forward:
        """The pose of actuator coordinates q (N, n) or (n,), by Newton on SE(3) from `near` (home by default).

        certify=False leaves the proof out, which takes most of the time: nothing is certified then. Raises MotionError
        for coordinates that are none, OutOfReach where no pose is found that has the lengths q (n,); among several,
        their `residual` tells.
        """
        return solve(self, q, self.home if near is None else near, certify)

    def check(self, pose: Pose, near: ArrayLike | None = None) -> Margins:
        """Travel, tilt and clearance against their limits, conditioning, and distance to the nearest singularity.

        near (n,) as in `inverse`: which of a pose's coordinates are meant, where there are several.
        """
        return measure(self, pose, near)

    def tables(self) -> tuple[Table, ...]:
        """Its axes and their limits."""
        return (axes_table(self),)

    def files(self) -> Mapping[str, Callable[[Path], None]]:
        """.toml: a file that `load_machine` reads, where `machine_toml` can; .csv and .json: the table."""
        from kinematics.machine_writer import machine_toml

        toml = lambda path: path.write_bytes(machine_toml(self).encode())  # noqa: E731
        return {".toml": toml, ".csv": self._csv, ".json": self._json}

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Its legs in the home pose; of machines without legs, the travel of each axis."""
        from kinematics.plots import at_home

        return at_home(self, ax)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}: {len(self.axes)} axes>"
