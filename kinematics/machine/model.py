"""The maps of a machine: everything numeric that follows from its kind's one expression.

Rates of functions of the pose along any motion, too. Axes and loads that do not fit the kind are
refused.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, TypeVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation.arrays import Array, finite_array, freeze_array, unit_vectors
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.errors import BadValue, MotionError, OutOfReach, locate_errors
from kinematics.foundation.names import add_article, count_noun
from kinematics.foundation.operations import refuse_unknown
from kinematics.foundation.options import check_arguments, fits
from kinematics.machine.axis import Axis
from kinematics.machine.kind import (
    Kind,
    PlacedSkeleton,
    Skeleton,
    columns,
    controlled_twist_symbols,
    controlled_twists,
    describe_pose,
    refuse_uncontrolled,
)
from kinematics.machine.load import Load
from kinematics.machine.pose import (
    PoseLike,
    check_pose,
    column,
    make_pose,
    read_numbers,
    read_pose,
    read_position,
    split_pose_symbols,
    to_numbers,
)
from kinematics.machine.shaper import Shaper, ShaperSeries

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose


class MovingPose:
    """A pose that passes through pose numbers x (12) with a twist (6) and its rate (6) in the base
    frame.

        p(t) = p + v t + v̇ t²/2,    R(t) = (1 + ω× t + (ω̇× + ω×ω×) t²/2) R

    agrees with every such motion up to the second order at t = 0.
    """

    def __init__(self, x: ca.SX) -> None:
        self.t = ca.SX.sym("t")
        self.twist, self.acceleration = ca.SX.sym("twist", 6), ca.SX.sym("acceleration", 6)
        position, rotation = split_pose_symbols(x)
        spin, turn = ca.skew(self.twist[3:]), ca.skew(self.acceleration[3:])
        half = self.t**2 / 2
        self.position = position + self.twist[:3] * self.t + self.acceleration[:3] * half
        self.rotation = (ca.SX.eye(3) + spin * self.t + (turn + spin @ spin) * half) @ rotation

    def derivatives(self, values: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """A column of values of the pose, its first and its second derivative at t = 0."""
        first = ca.jacobian(values, self.t)
        second = ca.jacobian(first, self.t)
        value, first, second = (ca.substitute(each, self.t, 0) for each in (values, first, second))
        return value, first, second


def rates(machine: Kind, x: ca.SX, near: ca.SX, inputs: ca.SX) -> Expression:
    """Inputs, twist (6), its rate (6) -> q̇ (n), q̈ (n), and twist and rate (6, 6) with what
    follows filled in.
    """
    moving = MovingPose(x)
    q = machine.expression(moving.position, moving.rotation, near)
    position, rotation = machine.fill_pose(moving.position, moving.rotation, q)
    _, qd, qdd = moving.derivatives(q)
    _, v, a = moving.derivatives(position)
    r, r1, r2 = (ca.reshape(each, 3, 3) for each in moving.derivatives(ca.vec(rotation)))
    out = ca.vertcat(qd, qdd, v, _skew_vector(r1 @ r.T), a, _skew_vector(r2 @ r.T))
    return Expression("rates", ca.vertcat(inputs, moving.twist, moving.acceleration), out)


def _skew_vector(m: ca.SX) -> ca.SX:
    """The vector of the skew part: ω of Ṙ Rᵀ = ω×, ω̇ of R̈ Rᵀ = ω̇× + ω×ω×."""
    column: ca.SX = ca.vertcat(m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]) / 2
    return column


BESIDE_HOME, LEAST_SHARE = 0.01, 1e-6
"""In characteristic lengths, how far beside home it is looked which axes move the platform along a
direction; and of an axis' whole motion of the platform, the share along it below which it does not.
"""
M = TypeVar("M", bound="MachineModel")
T = TypeVar("T")


def check_axes(of: Kind, name: str, given: Iterable[Axis]) -> tuple[Axis, ...]:
    """As many axes as there are freedoms, each of its sort, no two with the same name or the same
    driver.
    """
    kind, count = type(of).__name__.lower(), len(of.freedom)
    rows: Any = given
    axes: tuple[Axis, ...] = tuple(rows) if fits(rows, Iterable[object]) else (rows,)
    strange = [axis for axis in axes if not isinstance(axis, Axis)]
    if strange:
        raise MotionError(f"machine {name}: axes must be {count} of Axis, not {strange[0]!r:.100}")
    if len(axes) != count:
        raise MotionError(
            f"machine {name}: {count_noun(len(axes), 'axis')}; {add_article(kind)} has {count}, for "
            f"{', '.join(of.freedom)}"
        )
    for axis, sort in zip(axes, of.sorts, strict=False):
        if axis.kind != sort:
            told = f"axis {axis.name} is {axis.kind}; {add_article(kind)} has a {sort} one there"
            raise MotionError(f'machine {name}: {told}: give it kind="{sort}"')
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


def check_load(of: Kind, name: str, load: Load) -> Load:
    """A load that fits the machine. Raises MotionError for legs that it has not."""
    if load.legs and of.legs == 0:
        raise MotionError(f"machine {name} has no legs that could have masses")
    if len(load.legs) not in (0, 1, of.legs):
        raise MotionError(
            f"machine {name}: {len(load.legs)} legs with masses; give one for all, or {of.legs}"
        )
    return load


class MachineModel(Kind):
    """A machine of n axes that carries a platform (or tool): its maps, without what is computed
    with them.

    Its kind states the inverse map once; all else here follows from that: see
    `kinematics.machine.kind`.
    """

    def __init__(
        self,
        name: str,
        axes: Iterable[Axis],
        home: PoseLike,
        near: ArrayLike | None = None,
        load: Load | None = None,
    ) -> None:
        """near (n,): which of the home pose's coordinates are meant, where there are several (zeros
        by default).
        """
        if not isinstance(name, str) or not name:
            raise MotionError(f"a machine needs a name, a text that is not empty, not {name!r}")
        self.home_numbers = freeze_array(read_numbers(name, "home", home))
        if read_position(home) is None:
            self.home = read_pose(f"machine {name}: home", home)
        self.name, self.axes = name, check_axes(self, name, axes)
        self._derived: dict[Callable[..., Any], Any] = {}
        self._original: Self | None = None
        self._of_load: dict[Callable[..., Any], Any] = {}
        self.load = check_load(self, self.name, Load() if load is None else load)
        with locate_errors(f"machine {name}"):  # operations that nothing here can bound
            refuse_unknown(self.inverse_map.function)
        chosen = self._check_near(np.zeros(len(self.axes)) if near is None else near)
        self.home_q: Array = freeze_array(self._locate_numbers(self.home_numbers, chosen)[0])

    @cached_property
    def home(self) -> Pose:  # type: ignore[override]
        """The pose from which travel and pulses count: made when it is first used, where it is not
        turned.
        """
        return make_pose(self.home_numbers[0, :3], np.zeros(3))

    @check_arguments()
    def carrying(self, load: Load) -> Self:
        """The same machine with another load."""
        other = self._copy()
        other.load = check_load(self, self.name, load)
        other._of_load = {}
        return other

    def driven_by(self, axes: Iterable[Axis]) -> Self:
        """The same machine with other actuators: what each may do and how it counts; names, kinds
        and home stay.

        Raises MotionError for axes that are not as many, or not called as the machine's own.
        """
        other = self._copy()
        names = tuple(axis.name for axis in self.axes)
        other.axes = check_axes(self, self.name, axes)
        given = tuple(axis.name for axis in other.axes)
        if given != names:
            raise MotionError(
                f"machine {self.name}: its axes are called {', '.join(names)}, not {', '.join(given)}; keep their names"
            )
        other._of_load = {}
        return other

    def shape_along(self, direction: ArrayLike, shaper: Shaper | ShaperSeries) -> Self:
        """The same machine, with a shaper more on every axis that moves the platform's origin along
        a direction (3,).

        The direction is in the base frame. Home and poses beside it are looked at: a leg may stand
        across it at home. An axis that has the very shaper already keeps it once: that cancels the
        vibration. Raises MotionError where no axis does, for more shapers on one than it takes, and
        for what is no shaper.
        """
        from scipy.spatial.transform import RigidTransform, Rotation

        along, free = (
            unit_vectors(direction, f"machine {self.name}: direction", (3,)),
            columns(self),
        )
        lengths = np.where(free < 3, 1.0, self.characteristic_length)
        aside = (
            BESIDE_HOME
            * self.characteristic_length
            * np.cos(np.arange(1.0, 1 + len(free)))
            / lengths
        )
        share = np.zeros(len(self.axes))
        for sign in (0, 1, -1):
            moved = np.zeros(6)
            moved[free] = sign * aside
            turned = Rotation.from_rotvec(moved[3:]) * self.home.rotation
            try:
                beside = RigidTransform.from_components(self.home.translation + moved[:3], turned)
                controlled = controlled_twists(self, to_numbers(beside))[0]
                twists = np.linalg.inv(self.jacobian(beside, self.home_q) @ controlled)
            except (MotionError, np.linalg.LinAlgError):  # out of reach, or singular
                continue
            size = np.linalg.norm(twists * lengths[:, None], axis=0)
            share = np.maximum(share, np.abs(along[free[free < 3]] @ twists[free < 3]) / size)
        if not (share > LEAST_SHARE).any():
            moves = ", ".join(self.freedom)
            raise MotionError(
                f"machine {self.name}: no axis moves the platform along {np.round(along, 6).tolist()} at home; it "
                f"moves {moves}: give a direction in which it does, or take the vibration out"
            )
        some = zip(self.axes, share > LEAST_SHARE, strict=True)
        return self.driven_by([axis.add_shaper(shaper) if moves else axis for axis, moves in some])

    def rename(self, name: str) -> Self:
        """The same machine by another name, as of a copy of its file."""
        other = self._copy()
        other.name = name
        return other

    def _copy(self) -> Self:
        """Return a copy that shares all that `derive` makes of the original's geometry."""
        other = copy(self)
        other._original = self._original or self
        return other

    def symbolic(self, x: ca.SX, near: ca.SX) -> ca.SX:
        """Coordinates (n,) of pose numbers (12), to be composed with whatever they depend on."""
        return self.expression(*split_pose_symbols(x), near)

    @cached_property
    def inverse_map(self) -> Expression:
        """Pose numbers (12), and near (n) where branched -> q (n)."""
        x, near = self._symbols()
        return Expression("inverse", self._inputs(x, near), self.symbolic(x, near))

    @cached_property
    def jacobian_map(self) -> Expression:
        """The same -> J (n, 6) row by row, as in `jacobian`."""
        (x, near), twist = self._symbols(), ca.SX.sym("twist", 6)
        position, rotation = split_pose_symbols(x)
        moved = self.expression(
            position + twist[:3], rotation + ca.skew(twist[3:]) @ rotation, near
        )
        jacobian = ca.substitute(ca.jacobian(moved, twist), twist, ca.SX.zeros(6))
        return Expression("jacobian", self._inputs(x, near), ca.vec(jacobian.T))

    @cached_property
    def controlled_map(self) -> Expression:
        """Map the inputs of `inverse_map` to the square Jacobian (n, n), row by row, of controlled
        twists.
        """
        x, near = self._symbols()
        rotation = split_pose_symbols(x)[1]
        inputs = self._inputs(x, near)
        full = ca.reshape(self.jacobian_map.function(inputs), 6, -1).T
        square = full @ controlled_twist_symbols(self, rotation)
        return Expression("controlled", inputs, ca.vec(square.T))

    @cached_property
    def carried_map(self) -> Expression:
        """The same -> pose numbers (12) with what follows filled in."""
        x, near = self._symbols()
        return Expression(
            "carried",
            self._inputs(x, near),
            column(*self.fill_pose(*split_pose_symbols(x), self.symbolic(x, near))),
        )

    @cached_property
    def tilt_map(self) -> Expression:
        """Pose numbers (12) -> cosines of the joints' tilts (m)."""
        x = ca.SX.sym("x", 12)
        return Expression("tilts", x, self.tilts(*split_pose_symbols(x)))

    @property
    def parts(self) -> Skeleton:
        """The skeleton at home: which bars and pivots there are.

        Not kept: CasADi's symbols go to no other process.
        """
        x, q = (ca.SX(ca.DM(values)) for values in (to_numbers(self.home)[0], self.home_q))
        return self.skeleton(*self.fill_pose(*split_pose_symbols(x), q), q)

    @cached_property
    def rates_map(self) -> Expression:
        """The same, a twist (6) and its rate (6) -> q̇ (n), q̈ (n), and twist and rate (6, 6) of
        what is carried.
        """
        x, near = self._symbols()
        return rates(self, x, near, self._inputs(x, near))

    def _symbols(self) -> tuple[ca.SX, ca.SX]:
        return ca.SX.sym("x", 12), ca.SX.sym("near", len(self.axes))

    def _inputs(self, x: ca.SX, near: ca.SX) -> ca.SX:
        return ca.vertcat(x, near) if self.branched else x

    def inputs(self, x: Array, near: Array) -> Array:
        """What the maps take: pose numbers (N, 12), and near (n,) or (N, n) beside them where
        branched.
        """
        if not self.branched:
            return x
        return np.concatenate([x, np.broadcast_to(near, (len(x), len(self.axes)))], 1)

    def inverse(self, pose: PoseLike, near: ArrayLike | None = None) -> Array:
        """Find the actuator coordinates of poses.

        Parameters
        ----------
        pose
            One or N in the base frame: a RigidTransform, or numbers as of `read_pose`.
        near
            (n,) picks branch and turn where there are several. None: home's.

        Returns
        -------
        q
            (n,) of one pose, (N, n) of N: m or rad.

        Raises
        ------
        OutOfReach
            No solution exists: too far, or off the machine's freedom.
        MotionError
            It is no pose, such as a mirrored one.
        """
        pose = self.read_pose(pose)
        q = self.locate_pose(pose, near)[1]
        return q[0] if pose.single else q

    def read_pose(self, pose: PoseLike) -> Pose:
        """A pose as it is, or of numbers in the base frame
        (`kinematics.machine.pose.read_pose`).
        """
        return read_pose(f"machine {self.name}: pose", pose)

    def locate_pose(self, pose: Pose, near: ArrayLike | None = None) -> tuple[Array, Array]:
        """Numbers (N, 12) and coordinates (N, n) of the poses that a caller gives; see `inverse`
        for what it raises.
        """
        x = check_pose(self.name, "pose", pose)
        return x, self.locate_numbers(x, near)

    def locate_numbers(self, x: Array, near: ArrayLike | None = None) -> Array:
        """Find the coordinates (N, n) of pose numbers (N, 12). Raises as `inverse`."""
        refuse_uncontrolled(self, x)
        return self._locate_numbers(x, self._check_near(near))

    def _locate_numbers(self, x: Array, chosen: Array) -> Array:
        """Coordinates (N, n) of pose numbers (N, 12) near chosen (n,). Raises OutOfReach."""
        q = self.inverse_map(self.inputs(x, chosen))
        lost = self._is_lost(q).any(1)
        for other in self.alternatives(chosen) if lost.any() else ():
            q[lost] = self.inverse_map(self.inputs(x[lost], other))
            lost = self._is_lost(q).any(1)
        if lost.any():
            first = int(np.argmax(lost))
            axes = ", ".join(
                axis.name
                for axis, out in zip(self.axes, self._is_lost(q)[first], strict=True)
                if out
            )
            home = describe_pose(self.home_numbers, 0).removeprefix("the pose, ")
            told = f"no actuator coordinates reach {describe_pose(x, first)}: there is no position of {axes}"
            raise OutOfReach(f"machine {self.name}: {told}; bring it nearer to home, {home}")
        return q

    def _is_lost(self, q: Array) -> np.ndarray:
        return np.asarray(~(np.isfinite(q) & (q >= (0.0 if self.lengths else -np.inf))))

    def jacobian(self, pose: PoseLike, near: ArrayLike | None = None) -> Array:
        """Find the Jacobian at poses: dq = J [dx, dy, dz, wx, wy, wz] in the base frame.

        The velocity is that of the platform's origin, the reference point.

        Parameters
        ----------
        pose, near
            As of `inverse`.

        Returns
        -------
        J
            (n, 6) of one pose, (N, n, 6) of N.

        Raises
        ------
        OutOfReach
            As `inverse`.
        MotionError
            As `inverse`; and where coordinates have no finite rates: an arm stretched out, a leg of
            no length.
        """
        pose = self.read_pose(pose)
        x, q = self.locate_pose(pose, near)
        j = self.jacobian_map(self.inputs(x, q)).reshape(-1, len(self.axes), 6)
        endless = ~np.isfinite(j).all((1, 2))
        if endless.any():
            first = int(np.argmax(endless))
            raise MotionError(
                f"machine {self.name} is singular at {describe_pose(x, first)}: its coordinates "
                "have no finite rates there; keep away from it (check tells how near it is)"
            )
        return j[0] if pose.single else j

    def _check_near(self, near: ArrayLike | None) -> Array:
        if near is None:
            return self.home_q
        return finite_array(near, f"machine {self.name}: near", (len(self.axes),))

    def start(self, q: Array, near: Array) -> Array:
        """Pose numbers (N, 12) from which `forward` looks for coordinates q (N, n), asked from near
        (N, 12).
        """
        return near

    @cached_property
    def skeleton_map(self) -> Expression:
        """x (12), q (n) -> all points of the skeleton, bars first, one after the other: see
        `place_skeleton`.
        """
        x, q = ca.SX.sym("x", 12), ca.SX.sym("q", len(self.axes))
        parts = self.skeleton(*self.fill_pose(*split_pose_symbols(x), q), q)
        points = [end for bar in parts.bars for end in (bar.start, bar.end)] + [
            pivot.at for pivot in parts.pivots
        ]
        return Expression(
            "skeleton", ca.vertcat(x, q), ca.vertcat(*points) if points else ca.SX(0, 1)
        )

    def derive(self: M, build: Callable[[M], T], *, of_load: bool = False) -> T:
        """Return what a function makes of this machine, made once.

        It is made of the original of all copies.

        of_load  it also depends on the load and the actuators: copies with others make it anew
        """
        if of_load:
            made, source = self._of_load, self
        else:
            made, source = self._derived, self._original or self
        if build not in made:
            made[build] = build(source)
        result: T = made[build]
        return result


def square_jacobian(machine: MachineModel, x: Array, near: Array) -> Array:
    """(N, n, n) of pose numbers x (N, 12): ∂q by the twists that the machine controls
    (`controlled_twists`).
    """
    entries = machine.controlled_map(machine.inputs(x, near))
    return entries.reshape(len(x), len(machine.axes), len(machine.axes))


def scaled_jacobian(machine: MachineModel, x: Array, near: Array) -> Array:
    """(N, n, n) the same with every column in axis units per metre: turns count at the
    characteristic length.
    """
    scale = np.where(columns(machine) < 3, 1.0, 1.0 / machine.characteristic_length)
    return square_jacobian(machine, x, near) * scale


def place_skeleton(machine: MachineModel, x: Array, q: Array) -> PlacedSkeleton:
    """A machine's skeleton at pose numbers x (N, 12) and the coordinates q (N, n) that belong to
    them.
    """
    points = machine.skeleton_map(np.concatenate([x, q], 1)).reshape(len(x), -1, 3)
    ends = 2 * len(machine.parts.bars)
    return PlacedSkeleton(
        freeze_array(points[:, :ends].reshape(len(x), -1, 2, 3)), freeze_array(points[:, ends:])
    )
