"""A posture: one pose with the coordinates of every actuator, the tilt of every joint, its margins
and its proof.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinematics.analysis.margins import USE_ROUNDING, Margins, measure
from kinematics.foundation.arrays import Array, finite_array, freeze_fields
from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.foundation.names import count_noun
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.rotations import find_angles
from kinematics.foundation.table import SCALES, Column, Table
from kinematics.machine.machine_file import MachineSource, load_machine
from kinematics.machine.model import scaled_jacobian, square_jacobian
from kinematics.machine.motion import describe_singularity, is_singular
from kinematics.machine.pose import COMPONENTS, PoseLike, check_pose, from_numbers

if TYPE_CHECKING:
    from kinematics.machine.machine import Machine
    from kinematics.machine.pose import Pose

SAME_POSE_TOLERANCE = 1e-6
"""m, or of a rotation's entries, by which two poses differ at most that are one."""
MAX_PULSES = 2.0**53
"""Pulses from home that are told apart."""
NOT_CERTIFIED = (
    "the straight motion from home is not proved to be free of singularities; check may prove another way there, as a "
    "program"
)
LIMITS_KEPT = "limits kept"
UNLIMITED = {"inf": "unlimited", "-inf": "unlimited"}


@dataclass(frozen=True, slots=True)
class Posture(Result):
    """The axes, joints and margins of a machine at one pose.

    numbers    (12,) position and rotation rows of the pose in the base frame, with what follows as
               the axes lead it
    q          (n,) coordinates of the actuators: leg lengths between joint centres, slide
               positions, joint angles
    margins    travel, tilt, clearance, conditioning and distance to singularity
    residual   m or rad, the largest |inverse(pose) − q|
    certified  whether the straight motion from home arrives in this pose and no other, as `Forward`
               has it
    """

    machine: Machine = field(repr=False)
    numbers: Array
    q: Array
    margins: Margins = field(repr=False)
    residual: float
    certified: bool

    def __post_init__(self) -> None:
        freeze_fields(self, "numbers", "q")

    @property
    def pose(self) -> Pose:
        """The pose in the base frame."""
        return from_numbers(self.numbers)

    @property
    def from_home(self) -> Pose:
        """The same pose, relative to home: what a program in the frame "home" states."""
        return self.machine.home.inv() * self.pose

    @property
    def places(self) -> Array:
        """(2, 6) x, y, z (m) and θx, θy, θz (rad): relative to home, and in the base frame."""
        base = self.numbers[None]
        home = self.machine.home_numbers
        turn, home_turn = (x[0, 3:].reshape(3, 3) for x in (base, home))
        positions = np.concatenate([(base - home)[:, :3] @ home_turn, base[:, :3]])
        return np.concatenate([positions, find_angles(np.stack([home_turn.T @ turn, turn]))], 1)

    @property
    def travel(self) -> Array:
        """(n,) coordinates from home."""
        return np.asarray(self.q - self.machine.home_q)

    @property
    def counts(self) -> np.ndarray:
        """(n,) whole pulses from home, in the sense of the axes; what compensation adds is left
        out.
        """
        return np.rint(self.travel / [axis.pulse for axis in self.machine.axes]).astype(np.int64)

    @property
    def directions(self) -> Array:
        """(3,) α, β, γ (rad): between the base frame's x, y, z and the platform's z axis [Sahbaz
        2007].

        cos α = R[0, 2], cos β = R[1, 2], cos γ = R[2, 2]; by atan2, so that small angles keep their
        digits.
        """
        axis = self.numbers[3:].reshape(3, 3)[:, 2]
        across = [np.linalg.norm(np.delete(axis, k)) for k in range(3)]
        return np.arctan2(across, axis)

    @property
    def tilt(self) -> Array:
        """(m,) rad, of each joint of `margins.tilt_names` from its rest axis."""
        return np.asarray(self.margins.tilt[0] * self.margins.max_tilt)

    @property
    def doubt(self) -> str:
        """Why the pose is not certified, and what to do; "" where it is."""
        if self.certified:
            return ""
        x = self.numbers[None]
        jacobian = scaled_jacobian(self.machine, x, self.q[None])[0]
        if is_singular(self.machine, square_jacobian(self.machine, x, self.q[None]))[0]:
            return f"the pose is singular: {describe_singularity(self.machine, jacobian)}; choose a pose away from it"
        return NOT_CERTIFIED

    @property
    def violations(self) -> tuple[str, ...]:
        """Every limit that the pose breaks, the worst first: which, by how much, and what to do."""
        margins, told = self.margins, list[tuple[float, str]]()
        for axis, value, use in zip(self.machine.axes, self.travel, margins.travel[0], strict=True):
            if use > 1 + USE_ROUNDING:
                unit, scale = SCALES["human"][axis.unit]
                low, high = (f"{scale * end:.6g}" for end in axis.travel)
                text = f"{scale * value:.6g} {unit} from home, outside {low} to {high} {unit}"
                told.append((float(use), f"{axis.name} travel: {text}"))
        for name, tilt, limit in zip(margins.tilt_names, self.tilt, margins.max_tilt, strict=True):
            if limit < np.pi and tilt > limit * (1 + USE_ROUNDING):
                text = f"{name} tilt: {np.degrees(tilt):.6g}°, more than {np.degrees(limit):.6g}°"
                told.append((float(tilt / limit) if limit else np.inf, text))
        for name, gap in zip(margins.clearance_names, margins.clearance[0], strict=True):
            if gap < 0:
                told.append((np.inf, f"{name} clearance: they overlap by {-1e3 * gap:.4g} mm"))
        for name, use in zip(margins.room_names, margins.room[0], strict=True):
            if use > 1 + USE_ROUNDING:
                k = "xyz".index(name)
                low, high = (f"{1e3 * end:.6g}" for end in self.machine.room[k])
                text = f"{name} room: {1e3 * self.numbers[k]:.6g} mm, outside {low} to {high} mm"
                told.append((float(use), text))
        told.sort(key=lambda one: -one[0])
        return tuple(
            f"{text}; choose a pose closer to home, or with less rotation" for _, text in told
        )

    def tables(self) -> tuple[Table, ...]:
        """The pose in both frames, the platform's directions, every axis, every joint, and the
        margins.
        """
        parts = [self._poses(), self._directions(), self._axes()]
        if self.margins.tilt_names:
            parts.append(self._joints())
        return *parts, self._margins()

    def data(self) -> Table:
        """Every axis."""
        return self._axes()

    def files(self) -> Mapping[str, Callable[[Path], None]]:
        """.csv: every axis; .json: all tables."""
        return {".csv": self._csv, ".json": self._json}

    def _poses(self) -> Table:
        places = self.places
        columns = (
            Column("pose", ["from home", "in the base frame"]),
            *(
                Column(name, _tidy(places[:, k]), "m", "human", ".9g")
                for k, name in enumerate("xyz")
            ),
            *(
                Column(f"θ{name}", _tidy(places[:, 3 + k]), "rad", "human", ".9g")
                for k, name in enumerate("xyz")
            ),
        )
        return Table(
            f"{self.machine.name}: {type(self.machine).__name__.lower()}",
            columns,
            tuple(self._verdict()),
        )

    def _verdict(self) -> Iterator[str]:
        """Yield whether the machine may take the pose: limits that it violates first, then the
        proof of the pose.
        """
        violations = self.violations
        if violations:
            rest = f" and {count_noun(len(violations) - 1, 'more limit')}" if violations[1:] else ""
            yield f"NOT PERMITTED: {violations[0].partition(';')[0]}{rest}"
        arrives = "the straight motion from home arrives in this pose and no other"
        if not self.certified:
            yield f"NOT CERTIFIED: {self.doubt}"
        elif violations:
            yield f"without regard to limits {arrives}"
        else:
            yield f"certified: {arrives}"

    def _directions(self) -> Table:
        columns = (
            Column(name, [angle], "rad", "human", ".7g")
            for name, angle in zip("αβγ", self.directions, strict=True)
        )
        return Table("the platform's z axis against x, y, z of the base frame", tuple(columns))

    def _axes(self) -> Table:
        axes = self.machine.axes
        units = [axis.unit for axis in axes]
        what = "length" if self.machine.lengths else "position"
        columns = (
            Column("axis", [axis.name for axis in axes]),
            Column(what, self.q, units, "human", ".9g"),
            Column("from home", _tidy(self.travel), units, "human", ".9g"),
            Column("pulses", self.counts),
            Column(
                "travel from", [axis.travel[0] for axis in axes], units, "human", words=UNLIMITED
            ),
            Column("to", [axis.travel[1] for axis in axes], units, "human", words=UNLIMITED),
            Column("use", self.margins.travel[0], form=".4f"),
        )
        corrected = [axis.name for axis in axes if axis.compensate]
        notes = (f"pulses without what {', '.join(corrected)} compensate",) if corrected else ()
        return Table("the axes; pulses from home, in the sense of the axes", columns, notes)

    def _joints(self) -> Table:
        limit = self.margins.max_tilt
        bound = limit < np.pi
        columns = (
            Column("joint", self.margins.tilt_names),
            Column("tilt", self.tilt, "rad", "human", ".7g"),
            Column("limit", np.where(bound, limit, np.inf), "rad", "human", words=UNLIMITED),
            Column("use", np.where(bound, self.margins.tilt[0], 0.0), form=".4f"),
        )
        return Table("the joints; tilt from the rest axis", columns)

    def _margins(self) -> Table:
        (table,) = self.margins.tables()
        *uses, kept = table.columns[1:]
        return Table(table.title, (*uses, replace(kept, name=LIMITS_KEPT)), table.notes)


@check_arguments("machine", "pose")
def posture_of_pose(
    machine: MachineSource, pose: PoseLike, near: ArrayLike | None = None
) -> Posture:
    """Solve the inverse kinematics of a pose in the base frame: lengths, tilts, margins and proof.

    Parameters
    ----------
    machine
        The machine, its name, or the path of its file.
    pose
        One pose, or its numbers.
    near
        (n,) picks the branch, as in `Machine.inverse`.

    Returns
    -------
    Posture
        Coordinates, tilts, margins and proof.

    Raises
    ------
    OutOfReach
        No coordinates lead there.
    MotionError
        It is no pose, or several.
    """
    machine = load_machine(machine)
    pose = machine.read_pose(pose)
    if not pose.single:
        raise MotionError(f"machine {machine.name}: a posture is of one pose, not of {len(pose)}")
    return posture_of_numbers(machine, check_pose(machine.name, "pose", pose), near)


def posture_of_numbers(machine: Machine, x: Array, near: ArrayLike | None = None) -> Posture:
    """Solve the inverse kinematics of pose numbers (1, 12). Raises as `posture_of_pose`."""
    return _posture(machine, x, machine.locate_numbers(x, near)[0])


@check_arguments("machine")
def posture_of_axes(machine: MachineSource, q: ArrayLike, near: Pose | None = None) -> Posture:
    """Solve the forward kinematics of coordinates: pose, tilts, margins and proof about the way
    from home.

    Parameters
    ----------
    machine
        The machine, its name, or the path of its file.
    q
        (n,) m or rad.
    near
        Pose from which it is looked for. None: home.

    Returns
    -------
    Posture
        Pose, tilts, margins and proof.

    Raises
    ------
    OutOfReach
        No pose has these coordinates.
    MotionError
        They are none, or several rows of them.
    """
    machine = load_machine(machine)
    rows = finite_array(q, f"machine {machine.name}: coordinates")
    if rows.ndim != 1:
        raise MotionError(
            f"machine {machine.name}: a posture is of one row of coordinates, not of shape {rows.shape}"
        )
    found = machine.forward(rows, near, certify=False)
    return _posture(machine, found.numbers[None], rows)


def _posture(machine: Machine, x: Array, q: Array) -> Posture:
    pulses = np.abs(q - machine.home_q) / [axis.pulse for axis in machine.axes]
    if not pulses.max() < MAX_PULSES:
        axis = machine.axes[int(pulses.argmax())].name
        raise OutOfReach(
            f"machine {machine.name}: {axis} would be {pulses.max():.3g} pulses from home; choose a closer pose"
        )
    if machine.follows:
        x = machine.carried_map(machine.inputs(x, q))
    located = machine.locate_numbers(x, q)
    residual = float(np.abs(located - q).max())
    return Posture(
        machine, x[0], q, measure(machine, x, located), residual, _comes_to(machine, x, q)
    )


def _comes_to(machine: Machine, x: Array, q: Array) -> bool:
    """Whether the machine is proved to come from home to the pose of numbers x (1, 12) by
    coordinates q (n,).
    """
    try:
        proof = machine.forward(q)
    except OutOfReach:  # far from home: Newton finds no pose at all
        return False
    return bool(proof.certified) and bool(np.abs(proof.numbers - x).max() < SAME_POSE_TOLERANCE)


def refuse_dependent(machine: Machine, stated: Mapping[str, float]) -> None:
    """Raise MotionError for components of a pose (x … rz) that are stated, not 0, and follow from
    the others.
    """
    follows = [name for name in COMPONENTS if stated.get(name) and name in machine.follows]
    if follows:
        raise MotionError(
            f"machine {machine.name}: {', '.join(follows)} follow from the rest of the pose, so they cannot be asked "
            f"for; it moves {', '.join(machine.freedom)}: leave them out"
        )


def _tidy(values: Array) -> Array:
    """Without what rounding left of zeros: a thousandth of a nanometre, or as much of a radian."""
    return np.where(np.abs(values) < 1e-12, 0.0, values)
