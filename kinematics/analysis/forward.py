"""From actuator coordinates to the pose: Newton on SE(3), and the proof that it is the pose the
machine is in.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinematics.analysis.singularity import prove_nonsingular
from kinematics.foundation.arrays import Array, freeze_array, numeric_array
from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.foundation.names import count_noun
from kinematics.foundation.result import Result
from kinematics.foundation.rotations import find_angles, make_matrices
from kinematics.foundation.table import Column, Table
from kinematics.machine.kind import HELD_TOLERANCE, controlled_twists, refuse_uncontrolled
from kinematics.machine.model import MachineModel, square_jacobian
from kinematics.machine.pose import check_pose, from_numbers

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose

MAX_ITERATIONS = 50
RESIDUAL_TOLERANCE = 1e-9
"""m or rad: residual under which a pose counts as a solution (Newton leaves 1e-16; the rest is for
scale).
"""
# Share of the coordinates at which Newton stops: some thirty units in the last place.
STEP_ROUNDING = 1e-14
# m or rad by which coordinates of one pose on the same branch differ at most: rounding, where the
# machine is regular.
BRANCH_TOLERANCE = 1e-6
# Rows solved at a time, so that the memory that proofs take does not grow with the number of rows.
BLOCK_ROWS = 4096


@dataclass(frozen=True, slots=True)
class Forward(Result):
    """pose; residual (N,) largest |inverse(pose) − q|; certified (N,) bool.

    Plain scalars for a single q.

    residual: infinite where the search ended in a pose that no coordinates reach. certified:
    inverse(pose) is q, and the straight motion from `near` to this pose meets no singularity,
    proved cell by cell over the whole motion: a machine that goes this way from `near` arrives in
    this pose and no other. At home the machine has home's coordinates, up to full turns: from
    there, poses on another elbow are not certified. False throughout where no proof was asked for.
    """

    numbers: Array
    """(N, 12) or (12,): position and rotation rows of the pose."""
    residual: Array
    certified: np.ndarray

    @property
    def pose(self) -> Pose:
        """The pose in the base frame."""
        return from_numbers(self.numbers)

    def tables(self) -> tuple[Table, ...]:
        """The poses, what is left of their coordinates, and whether they are proved."""
        x = np.atleast_2d(self.numbers)
        positions = x[:, :3]
        angles = find_angles(x[:, 3:].reshape(-1, 3, 3))
        columns = (
            Column("row", range(len(positions))),
            *(Column(name, positions[:, k], "m", "human") for k, name in enumerate("xyz")),
            *(Column(f"r{name}", angles[:, k], "rad", "human") for k, name in enumerate("xyz")),
            Column("residual", np.atleast_1d(self.residual), "m or rad", form=".3g"),
            Column("certified", np.atleast_1d(self.certified), words={"False": "NO"}),
        )
        return (Table("poses in the base frame", columns),)


def solve(machine: MachineModel, q: ArrayLike, near: Pose | None, certify: bool = True) -> Forward:
    """Damped Newton in the twist of the platform, batched, then the certificate if it is asked for.

    See `Machine.forward` for what it raises.
    """
    given = _coordinates(machine, q)
    rows = np.atleast_2d(given)
    start = machine.home_numbers if near is None else check_pose(machine.name, "near", near)
    if len(start) not in (1, len(rows)):
        raise MotionError(
            f"machine {machine.name}: forward takes one pose `near`, or one for each of "
            f"{count_noun(len(rows), 'row')} of q, "
            f"not {len(start)}"
        )
    refuse_uncontrolled(machine, start, "near {}".format)
    blocks = [slice(first, first + BLOCK_ROWS) for first in range(0, max(1, len(rows)), BLOCK_ROWS)]
    start = np.broadcast_to(start, (len(rows), 12))
    parts = [_solve(machine, rows[b], start[b], certify) for b in blocks]
    x, residual, certified = (np.concatenate([part[k] for part in parts]) for k in range(3))
    if given.ndim == 2:
        return Forward(freeze_array(x), freeze_array(residual), freeze_array(certified))
    if machine.lengths and not residual[0] <= RESIDUAL_TOLERANCE * max(1.0, rows.max()):
        least = f"the nearest leaves {residual[0] * 1e3:.6g} mm"
        raise OutOfReach(
            f"machine {machine.name}: no pose was found that has the lengths {given * 1e3} mm; "
            f"{least if np.isfinite(residual[0]) else 'the pose given as `near` is itself out of reach'}; "
            "they may be out of reach: change them, or give a closer pose as `near`"
        )
    return Forward(freeze_array(x[0]), residual[0], certified[0])


def _coordinates(machine: MachineModel, q: ArrayLike) -> Array:
    """(N, n) or (n,), finite, and not below 0 where they are lengths."""
    n = len(machine.axes)
    told, given = (
        f"machine {machine.name}: forward takes finite coordinates (N, {n})",
        numeric_array(q),
    )
    if given is None or given.ndim not in (1, 2) or given.shape[-1] != n:
        raise MotionError(
            f"{told}, not {f'{q!r:.100}' if given is None else f'shape {given.shape}'}"
        )
    rows, least = np.atleast_2d(given), 0.0 if machine.lengths else -np.inf
    wrong = ~(np.isfinite(rows) & (rows >= least))
    if wrong.any():
        row, k = np.argwhere(wrong)[0]
        axis = machine.axes[k]
        below = "; a length is not below 0" if rows[row, k] < least else ""
        raise MotionError(
            f"{told}, not {rows[row, k]} {axis.unit} for {axis.name} in row {row}{below}"
        )
    return given


def iterate_newton(machine: MachineModel, q: Array, start: Array) -> tuple[Array, Array]:
    """Pose numbers (N, 12) and residual (N,) of coordinates q (N, n), by Newton from pose numbers
    start (N, 12).

    What `solve` does before its proof, for many rows at once: nothing is checked of what is given,
    and where a machine has several poses of the same coordinates, which one is found is not proved.
    """
    x = _newton(machine, q, machine.start(q, start).copy())
    if machine.follows:
        carried = machine.carried_map(machine.inputs(x, q))
        x = np.where(np.isfinite(carried).all(1, keepdims=True), carried, x)
    return x, _residual(machine, q, x)


def _residual(machine: MachineModel, q: Array, x: Array) -> Array:
    residual = np.abs(machine.inverse_map(machine.inputs(x, q)) - q).max(1)
    residual[np.isnan(residual)] = np.inf  # Newton stayed where no coordinates reach
    return np.asarray(residual)


def _solve(
    machine: MachineModel, q: Array, start: Array, certify: bool
) -> tuple[Array, Array, np.ndarray]:
    """Return pose numbers (N, 12), residual (N,) and certified (N,) of coordinates q (N, n), from
    start (N, 12).
    """
    x = iterate_newton(machine, q, start)[0]
    x[:, 3:] = _orthogonalise(x[:, 3:].reshape(-1, 3, 3)).reshape(-1, 9)
    residual = _residual(machine, q, x)
    certified = (residual < RESIDUAL_TOLERANCE) & certify & _starts_on_branch(machine, q, start)
    certified[certified] = prove_nonsingular(machine, start[certified], x[certified], q[certified])
    return x, residual, certified


def _orthogonalise(matrices: Array) -> Array:
    """Return the nearest rotations to products of rotations, which rounding leaves a few ulps off:
    a Newton step.
    """
    return np.asarray(matrices @ (3 * np.eye(3) - matrices.swapaxes(1, 2) @ matrices) / 2)


def _starts_on_branch(machine: MachineModel, q: Array, start: Array) -> np.ndarray:
    """(N,) bool: the machine stands at pose start (N, 12) on the branch of coordinates q (N, n).

    At home it has home's coordinates, up to full turns, and is not on the other elbow; in any other
    pose that it is asked from, it is taken to stand on the branch of q.
    """
    if not machine.branched:
        return np.ones(len(q), bool)
    apart = machine.inverse_map(machine.inputs(start, q)) - machine.home_q
    turning = np.array([axis.kind == "rotary" for axis in machine.axes])
    apart = np.where(turning, np.arctan2(np.sin(apart), np.cos(apart)), apart)
    elsewhere = (np.abs(start - machine.home_numbers) > HELD_TOLERANCE).any(1)
    return np.asarray(elsewhere | (np.abs(apart) < BRANCH_TOLERANCE).all(1))


def _newton(machine: MachineModel, q: Array, x: Array) -> Array:
    """x ← exp(δ) x with J δ = q − inverse(x), turning one radian at most; a step that gains nothing
    is quartered.

    δ moves what the machine controls; what is held or follows stays.
    """
    error = q - machine.inverse_map(machine.inputs(x, q))
    active, floor = np.arange(len(q)), max(1.0, np.abs(q).max(initial=0.0))
    damping = np.ones(len(q))
    for _ in range(MAX_ITERATIONS):
        size = np.abs(error[active]).max(1)
        # a hopeless damping ends the search
        active = active[(size > STEP_ROUNDING * floor) & (damping[active] > 1e-6)]
        if not len(active):
            break
        newton = _newton_step(square_jacobian(machine, x[active], q[active]), error[active])
        step = (controlled_twists(machine, x[active]) @ newton[:, :, None])[:, :, 0]
        turn = np.linalg.norm(step[:, 3:], axis=1)
        step *= (damping[active] / np.maximum(turn, 1.0))[:, None]
        trial = _apply_twist(x[active], step)
        error_trial = q[active] - machine.inverse_map(machine.inputs(trial, q[active]))
        better = np.abs(error_trial).max(1) < np.abs(error[active]).max(1)
        won = active[better]
        x[won], error[won] = trial[better], error_trial[better]
        damping[won] = np.minimum(1.0, 2 * damping[won])
        lost = active[~better]
        damping[lost] /= 4
    return x


def _newton_step(jacobian: Array, error: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(jacobian, error[..., None])[..., 0], float)
    except np.linalg.LinAlgError:  # a pose of the batch is exactly singular
        return np.asarray((np.linalg.pinv(jacobian) @ error[..., None])[..., 0], float)


def _apply_twist(x: Array, twist: Array) -> Array:
    turned = make_matrices(twist[:, 3:]) @ x[:, 3:].reshape(-1, 3, 3)
    return np.concatenate([x[:, :3] + twist[:, :3], turned.reshape(-1, 9)], 1)
