"""What a machine is: its inverse map as one expression, and everything that follows from it."""

from collections.abc import Callable, Iterable, Mapping
from copy import copy
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import Array, finite, frozen
from kinematics.axis import Axis
from kinematics.errors import MotionError, OutOfReach
from kinematics.expression import Expression
from kinematics.forward import Forward, solve
from kinematics.freedom import refuse
from kinematics.given import bearing, driven
from kinematics.kind import Kind
from kinematics.load import Load
from kinematics.machine_tables import axes_table
from kinematics.margins import Margins, measure
from kinematics.pose import Pose, checked, column, numbers, symbols
from kinematics.rates import rates
from kinematics.regular import cell_map
from kinematics.result import Result
from kinematics.skeleton import Skeleton, skeleton_map
from kinematics.table import Table
from kinematics.virtual_work import Balance, force_map, holding_map, loaded

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Machine(Kind, Result):
    """A machine of n axes that carries a platform (or tool).

    Its kind states the inverse map once; all else here follows from that: see `kinematics.kind`.
    """

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
        self.name, self.axes, self.home = name, driven(self, name, axes), home
        self.load = bearing(self, self.name, Load() if load is None else load)
        self.home_q: Array = frozen(self.inverse(home, np.zeros(len(self.axes)) if near is None else near))

    def carrying(self, load: Load) -> Self:
        """The same machine with another load."""
        other = copy(self)
        other.load = bearing(self, self.name, load)
        other._forget("force_map", "holding_map", "loaded")
        return other

    def driven_by(self, axes: Iterable[Axis]) -> Self:
        """The same machine with other actuators: what each may do and how it counts; names, kinds and home stay.

        Raises MotionError for axes that are not as many, or not called as the machine's own.
        """
        other, names = copy(self), tuple(axis.name for axis in self.axes)
        other.axes = driven(self, self.name, axes)
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

    @property
    def parts(self) -> Skeleton:
        """The skeleton at home: which bars and pivots there are. Not kept: CasADi's symbols go to no other process."""
        x, q = (ca.SX(ca.DM(values)) for values in (numbers(self.home)[0], self.home_q))
        return self.skeleton(*self.carried(*symbols(x), q), q)

    @cached_property
    def skeleton_map(self) -> Expression:
        """x (12), q (n) -> the points of the skeleton: see `kinematics.skeleton.place`."""
        return skeleton_map(self)

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

        return {
            ".toml": lambda path: path.write_bytes(machine_toml(self).encode()),
            ".csv": self._csv,
            ".json": self._json,
        }

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Its legs in the home pose; of machines without legs, the travel of each axis."""
        from kinematics.plots import at_home

        return at_home(self, ax)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}: {len(self.axes)} axes>"
