"""The parameters of a calibration: which there are, and how the parts of a model choose among them.

What a machine that has them does and is measured to do follows, with its derivatives.
"""

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from kinematics.calibration.measurements import COMPONENTS, Measurements
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import nearest
from kinematics.kinds.hexapod import Hexapod
from kinematics.machine.kind import controlled_twist_symbols, controlled_twists
from kinematics.machine.machine import Machine
from kinematics.machine.pose import Pose, from_numbers, make_pose, split_pose_symbols, to_numbers

XYZ = ("x", "y", "z")
FRAME = (*XYZ, "rx", "ry", "rz")
DEFAULT = ("factor", "frame-yaw")
"""One common factor, and where the measuring frame stands and how it is turned about z: five
parameters.
"""


@dataclass(frozen=True, slots=True)
class FreeParameter:
    """One free parameter: it moves the entries `moves` of the full vector together."""

    name: str
    unit: str
    moves: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class FullVector:
    """Every number that a model can free, in one vector (k,): factors, offsets, joints (of a
    hexapod), frame.

    The frame is x, y, z (m) and rx, ry, rz (rad, about the moving axes in turn), in the home pose's
    frame.
    """

    axes: tuple[str, ...]
    units: tuple[str, ...]
    nominal: Array

    @property
    def size(self) -> int:
        return len(self.nominal)

    def factors(self) -> slice:
        return slice(0, len(self.axes))

    def offsets(self) -> slice:
        return slice(len(self.axes), 2 * len(self.axes))

    def joints(self) -> slice:
        """Base joints one after the other, then platform joints; empty for a machine without."""
        return slice(2 * len(self.axes), self.size - 6)

    def frame(self) -> slice:
        return slice(self.size - 6, self.size)


def full_vector(machine: Machine) -> FullVector:
    """The full vector of a machine, as its file has it."""
    n = len(machine.axes)
    joints = np.zeros(0)
    if isinstance(machine, Hexapod):
        joints = np.concatenate([machine.base.ravel(), machine.platform.ravel()])
    names, units = (
        tuple(axis.name for axis in machine.axes),
        tuple(axis.unit for axis in machine.axes),
    )
    return FullVector(
        names, units, freeze_array(np.concatenate([np.ones(n), np.zeros(n), joints, np.zeros(6)]))
    )


def free_parameters(vector: FullVector, parts: Sequence[str]) -> tuple[FreeParameter, ...]:
    """The free parameters of a model that consists of `parts`.

    Raises MotionError for parts that make no model.
    """
    if isinstance(parts, str) or not isinstance(parts, Sequence):
        raise MotionError(
            f"calibration model: {parts!r} is not a sequence of parts; parts: {', '.join(PARTS)}"
        )
    for part in parts:
        if not isinstance(part, str):
            raise MotionError(
                f"calibration model: part {part!r:.60} is not a text; parts: {', '.join(PARTS)}"
            )
        if part not in PARTS:
            raise MotionError(
                f'"{part}" is not part of a calibration model{nearest(part, PARTS)}; parts: {", ".join(PARTS)}'
            )
    for whole, contained in (("factors", "factor"), ("frame", "frame-yaw")):
        if whole in parts and contained in parts:
            raise MotionError(
                f"calibration model: {contained} is contained in {whole}; give one of them"
            )
    if not parts or len(set(parts)) < len(parts):
        raise MotionError(
            f"calibration model: needs one part or more, each once, not {list(parts)}"
        )
    if "joints" in parts and vector.size == 2 * len(vector.axes) + len(FRAME):
        raise MotionError(
            "calibration model: joints are identified for hexapods only; leave that part out"
        )
    return tuple(parameter for part in PARTS if part in parts for parameter in PARTS[part](vector))


def selection(vector: FullVector, parameters: Sequence[FreeParameter]) -> Array:
    """S (k, m): full vector = nominal + S · parameters' changes."""
    chosen = np.zeros((vector.size, len(parameters)))
    for column, parameter in enumerate(parameters):
        chosen[list(parameter.moves), column] = 1.0
    return chosen


def _factor(vector: FullVector) -> Iterable[FreeParameter]:
    yield FreeParameter("factor", "", tuple(range(len(vector.axes))))


def _factors(vector: FullVector) -> Iterable[FreeParameter]:
    for k, axis in enumerate(vector.axes):
        yield FreeParameter(f"{axis} factor", "", (k,))


def _offsets(vector: FullVector) -> Iterable[FreeParameter]:
    first = vector.offsets().start
    for k, (axis, unit) in enumerate(zip(vector.axes, vector.units, strict=True)):
        yield FreeParameter(f"{axis} offset", unit, (first + k,))


def _joints(vector: FullVector) -> Iterable[FreeParameter]:
    entry = vector.joints().start
    for end in ("base", "platform"):
        for axis in vector.axes:
            for component in XYZ:
                yield FreeParameter(f"{axis} {end} {component}", "m", (entry,))
                entry += 1


def _frame(vector: FullVector) -> Iterable[FreeParameter]:
    for k, name in enumerate(FRAME):
        yield FreeParameter(
            f"frame {name}", "m" if name in XYZ else "rad", (vector.frame().start + k,)
        )


def _frame_yaw(vector: FullVector) -> Iterable[FreeParameter]:
    return (
        parameter for parameter in _frame(vector) if parameter.name not in ("frame rx", "frame ry")
    )


def calibration_parts() -> tuple[str, ...]:
    """Names of the parts of a calibration model."""
    return tuple(PARTS)


PARTS: dict[str, Callable[[FullVector], Iterable[FreeParameter]]] = {
    "factor": _factor,
    "factors": _factors,
    "offsets": _offsets,
    "joints": _joints,
    "frame": _frame,
    "frame-yaw": _frame_yaw,
}
"""Parts of a model: a common pulse factor, one per axis; a length offset per axis; the joints'
centres; the measuring frame, whole or turned about z only. factors, offsets and joints of a hexapod
are 48 parameters.
"""


MAX_ITERATIONS = 30
# m or rad of the coordinates at which Newton stops: rounding of lengths of decimetres, far below
# any measurement.
CLOSURE_TOLERANCE = 1e-13
# The same, that a pose may be off where rounding kept Newton from stopping.
MAX_CLOSURE_GAP = 1e-9


@dataclass(frozen=True, slots=True)
class Prediction:
    """Forward kinematics of the machine with a full vector of parameters, and the errors against
    the measurements.

    errors     (N, 8) predicted − measured, by `measurements.COMPONENTS`
    jacobian   (N, 8, k) derivatives of the errors with respect to the full vector

    Poses are looked for from the commanded ones whatever was asked before, so that errors are a
    function of the parameters, and a pose on the other side of a singularity is none: the machine
    has not been driven there.
    """

    machine: Machine
    vector: FullVector
    measurements: Measurements
    sent: Array
    _closure: Expression
    _error: Expression
    _commanded: Array

    @classmethod
    def from_measurements(
        cls, machine: Machine, vector: FullVector, measurements: Measurements
    ) -> "Prediction":
        """Of commanded poses that the nominal machine can take (see `reach`)."""
        commanded = machine.home * measurements.commanded
        sent = machine.inverse(commanded) - machine.home_q
        closure, error = _expressions(machine, vector)
        return cls(machine, vector, measurements, sent, closure, error, to_numbers(commanded))

    def poses(self, theta: Array, sent: Array, start: Array) -> Array:
        """Pose numbers (N, 12) at displacements sent (N, n), by Newton from start; NaN where it
        does not get there.
        """
        x = start.copy()
        rows = np.concatenate([sent, np.broadcast_to(theta, (len(x), len(theta)))], 1)
        n = len(self.vector.axes)
        for _ in range(MAX_ITERATIONS):
            out = self._closure(np.concatenate([x, rows], 1))
            gap, jacobian = out[:, :n], out[:, n : n + n * n].reshape(-1, n, n)
            if not np.isfinite(out).all() or np.abs(gap).max() < CLOSURE_TOLERANCE * max(
                1.0, np.abs(sent).max()
            ):
                break
            step = (controlled_twists(self.machine, x) @ _solve(jacobian, -gap[..., None]))[..., 0]
            # a step of more than a radian says nothing: the machine is far from where it started,
            # or singular
            step /= np.maximum(1.0, np.linalg.norm(step[:, 3:], axis=1))[:, None]
            x[:, :3] += step[:, :3]
            x[:, 3:] = (
                Rotation.from_rotvec(step[:, 3:]).as_matrix() @ x[:, 3:].reshape(-1, 3, 3)
            ).reshape(-1, 9)
        x[~(np.abs(gap).max(1) < MAX_CLOSURE_GAP)] = np.nan
        return x

    def measured_poses(self, theta: Array) -> Pose:
        """The poses (N) as they are seen in the measuring frame, relative to the home pose."""
        actual = from_numbers(self.poses(theta, self.sent, self._commanded))
        frame = theta[self.vector.frame()]
        return make_pose(frame[:3], frame[3:]) * self.machine.home.inv() * actual

    def at(self, theta: Array) -> tuple[Array, Array]:
        """Errors and Jacobian at a full vector (k,); all NaN where the machine cannot be closed at
        some pose.
        """
        m, k = len(COMPONENTS), self.vector.size
        nothing = np.full((len(self.sent), m), np.nan), np.full((len(self.sent), m, k), np.nan)
        x = self.poses(theta, self.sent, self._commanded)
        if not np.isfinite(x).all():
            return nothing
        by_pose, by_theta = self._closure_derivatives(theta, x)
        if (
            _determinant_sign(by_pose)
            != _determinant_sign(self._closure_derivatives(self.vector.nominal, self._commanded)[0])
        ).any():
            return nothing
        n, theta = by_pose.shape[1], np.broadcast_to(theta, (len(x), k))
        out = self._error(np.concatenate([x, theta, to_numbers(self.measurements.measured)], 1))
        error, e_pose = out[:, :m], out[:, m : m + m * n].reshape(-1, m, n)
        e_theta = out[:, m + m * n :].reshape(-1, m, k)
        return error, e_theta - e_pose @ _solve(by_pose, by_theta)

    def _closure_derivatives(self, theta: Array, x: Array) -> tuple[Array, Array]:
        """Derivatives of the closure at pose numbers x (N, 12): by the pose (N, n, n), by the full
        vector (N, n, k).
        """
        n, k = len(self.vector.axes), self.vector.size
        closed = self._closure(
            np.concatenate([x, self.sent, np.broadcast_to(theta, (len(x), k))], 1)
        )
        return closed[:, n : n + n * n].reshape(-1, n, n), closed[:, n + n * n :].reshape(-1, n, k)


def _determinant_sign(jacobian: Array) -> Array:
    """(N,) sign of the determinant: it changes where the machine is singular [Gosselin and Angeles
    1990].
    """
    return np.asarray(np.linalg.slogdet(jacobian)[0])


def _solve(matrix: Array, right: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(matrix, right), float)
    except np.linalg.LinAlgError:  # a pose is exactly singular
        return np.full(right.shape, np.nan)


def _expressions(machine: Machine, vector: FullVector) -> tuple[Expression, Expression]:
    """(x, sent, θ) -> closure h (n), ∂h/∂pose (n, n), ∂h/∂θ (n, k); (x, θ, measured) -> errors, and
    both of theirs.
    """
    n = len(machine.axes)
    x, sent, theta = ca.SX.sym("x", 12), ca.SX.sym("sent", n), ca.SX.sym("theta", vector.size)
    measured, move = ca.SX.sym("measured", 12), ca.SX.sym("move", n)
    position, rotation = split_pose_symbols(x)
    twist = controlled_twist_symbols(machine, rotation) @ move
    moved = position + twist[:3], rotation + ca.skew(twist[3:]) @ rotation
    opened = _symbolic_machine(machine, theta[vector.joints()])
    nominal = ca.DM(machine.home_q)
    lengths = opened.expression(*moved, nominal + sent)
    gap = lengths - (nominal + theta[vector.offsets()] + theta[vector.factors()] * sent)
    error = _errors(machine, moved, theta[vector.frame()], measured)
    closure = Expression("closure", ca.vertcat(x, sent, theta), _with_derivatives(gap, move, theta))
    return closure, Expression(
        "error", ca.vertcat(x, theta, measured), _with_derivatives(error, move, theta)
    )


def _with_derivatives(value: ca.SX, move: ca.SX, theta: ca.SX) -> ca.SX:
    """A value and its derivatives by a move in what the machine controls, from none, and by θ."""
    by_pose, by_theta = ca.jacobian(value, move), ca.jacobian(value, theta)
    column = ca.vertcat(value, ca.vec(ca.densify(by_pose).T), ca.vec(ca.densify(by_theta).T))
    return ca.substitute(column, move, ca.SX.zeros(move.numel()))


def _symbolic_machine(machine: Machine, joints: ca.SX) -> Machine:
    """The machine with symbols for joints, so that its own expression states their effect."""
    if not isinstance(machine, Hexapod):
        return machine
    opened, points = copy(machine), ca.vertsplit(joints, 3)
    opened.base, opened.platform = points[:6], points[6:]  # type: ignore[assignment]  # symbols instead of numbers
    return opened


def _errors(machine: Machine, moved: tuple[ca.SX, ca.SX], frame: ca.SX, measured: ca.SX) -> ca.SX:
    """Errors (8,) of the pose as seen in the measuring frame; rotations as sin(angle) · axis,
    smooth at zero.
    """
    home = machine.home.as_matrix()
    turn = _turn(frame[3:])
    position = frame[:3] + turn @ ca.DM(home[:3, :3]).T @ (moved[0] - ca.DM(home[:3, 3]))
    rotation = turn @ ca.DM(home[:3, :3]).T @ moved[1]
    p, r = split_pose_symbols(measured)
    apart = rotation @ r.T
    about = ca.cross(r[:, 2], rotation[:, 2])
    return ca.vertcat(position - p, ca.inv_skew((apart - apart.T) / 2), (r.T @ about)[:2])


def _turn(angles: ca.SX) -> ca.SX:
    """Rx · Ry · Rz."""
    (cx, cy, cz), (sx, sy, sz) = ca.vertsplit(ca.cos(angles)), ca.vertsplit(ca.sin(angles))
    about_x = ca.blockcat([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = ca.blockcat([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = ca.blockcat([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_x @ about_y @ about_z
