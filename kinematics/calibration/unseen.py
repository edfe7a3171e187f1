"""Combinations of parameters that the fitted poses do not show, and poses that would show them.

The null space of the identification Jacobian J (rows: errors at the fitted poses) has two parts.
Some of its combinations have no effect at any pose: they only exchange, say, a turn of all base
joints for one of the frame, and do no harm. The others have an effect at poses that were not
measured, where the calibrated machine is then off by unknown amounts. With the rows J_c of
candidate poses in the machine's workspace and a basis Z of the null space, the second part is
the row space of J_c Z.

Poses are proposed one after the other, each the one that raises det(JᵀJ) most (D-optimal
design), until the weakest combination is shown evenly enough. Columns are scaled to unit length,
so that units drop out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.calibration.measurements import Measurements, select_rows, whole_poses
from kinematics.calibration.parameters import Prediction
from kinematics.calibration.result import MIN_EVENNESS, Observability, describe_combination
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.machine.machine import Machine
from kinematics.machine.pose import Pose, make_pose

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")
RANDOM_CANDIDATES = 60
"""Candidate poses besides two along every component: a few times as many as parameters need."""
REACHES = (0.2, 0.1, 0.05, 0.02, 0.01, 5e-3, 2e-3, 1e-3)
"""Distances from the measured poses, the largest first: m, or times `ANGLE_SHARE` rad."""
ANGLE_SHARE = 2.5
"""rad that are tried together with 1 m: half a radian is the most."""
LENGTH_STEP, ANGLE_STEP = 1e-3, np.deg2rad(0.5)
"""m and rad to which proposed poses are rounded."""
MIN_SHARE = 1e-6
"""Singular value, as a share of the largest, from which on candidates show a combination."""
MAX_PROPOSED = 12
"""Largest number of proposed poses."""
LEAST_INFORMATION = 1e-12
"""Share of a column's information that stands for none, so that determinants differ from zero."""
MAX_NAMED = 3
"""Largest number of combinations that a warning names; the report and calibration.json name all."""


@dataclass(frozen=True, slots=True)
class Unseen:
    """Combinations that the fitted poses do not show.

    count     number of all of them
    changes   (u, m) changes of the parameters, in their own units, with an effect at other poses,
              the strongest first
    proposed  (k, 6) poses that show these: x, y, z (m) and θx, θy, θz (rad) from home
    """

    count: int
    changes: Array
    proposed: Array

    def describe(self, names: Sequence[str]) -> str:
        """Return a warning that names the combinations and the proposed poses."""
        hidden = len(self.changes)
        listed = "; ".join(
            describe_combination(change, names) for change in self.changes[:MAX_NAMED]
        )
        more = f"; and {hidden - MAX_NAMED} more" if hidden > MAX_NAMED else ""
        poses = "; ".join(_describe_pose(pose) for pose in self.proposed.tolist())
        remedy = (
            f"measure at further poses, from home: {poses}"
            if poses
            else "measure at poses farther apart"
        )
        return (
            f"the fitted poses do not show {count_noun(hidden, 'combination')} of the {len(names)} parameters, which "
            f"{'keeps its nominal value' if hidden == 1 else 'keep their nominal values'}; at other poses the machine "
            f"may be off by any amount: {listed}{more}; {remedy}; or identify fewer parameters (--model)"
        )


def _describe_pose(pose: Sequence[float]) -> str:
    lengths = ", ".join(f"{1e3 * value:.4g}" for value in pose[:3])
    text = f"({lengths}) mm"
    if any(pose[3:]):
        text += f" turned ({', '.join(f'{np.rad2deg(angle):.4g}' for angle in pose[3:])}) deg"
    return text


def find_unseen(
    prediction: Prediction, theta: Array, observed: Observability, rows: tuple[Array, Array, Array]
) -> Unseen | None:
    """Find the combinations that the fitted poses do not show; None if they show all with an
    effect.

    rows: weights (8,) of the components, their use (8,), and the selection of the parameters (k, m)
    """
    count = len(observed.singular) - observed.rank
    if not count:
        return None
    poses = _find_candidates(prediction.machine, prediction.measurements)
    if not len(poses):
        nothing = freeze_array(np.empty((0, 6)))
        return Unseen(count, freeze_array(observed.unobservable_changes), nothing)
    shown = _find_rows(prediction, theta, poses, rows)
    # scaled like the columns of all poses, so that units drop out
    sigma = observed.singular[: observed.rank, None]
    known = sigma * observed.combinations[: observed.rank] / observed.scale
    length = np.sqrt((known**2).sum(0) + (shown**2).sum((0, 1)))
    scale = np.divide(1.0, length, out=np.ones_like(length), where=length > 0)
    known, shown = known * scale, shown * scale
    left = _null_space(known)
    _, sizes, combinations = np.linalg.svd(
        shown.reshape(-1, len(scale)) @ left, full_matrices=False
    )
    visible = sizes > MIN_SHARE * max(float(sizes[0]), 1.0)
    if not visible.any():
        return None
    changes = (combinations[visible] @ left.T) * scale
    chosen = _choose_poses(known, shown)
    return Unseen(count, freeze_array(changes), freeze_array(poses[chosen]))


def _null_space(rows: Array) -> Array:
    """Return an orthonormal basis (m, u) of the changes not shown by rows (r, m) of full rank."""
    return np.asarray(np.linalg.svd(rows, full_matrices=True)[2][len(rows) :].T)


def _find_candidates(machine: Machine, measured: Measurements) -> Array:
    """Return candidate poses (N, 6) around the fitted ones, within the limits, rounded."""
    fitted = measured.commanded[measured.fit]
    centre = np.concatenate([fitted.translation.mean(0), fitted.rotation.mean().as_euler("XYZ")])
    free = [COMPONENTS.index(name) for name in machine.freedom]
    reach = np.zeros((2, 6))
    for k in free:
        for side, sign in enumerate((-1.0, 1.0)):
            sizes = (sign * size * (1 if k < 3 else ANGLE_SHARE) for size in REACHES)
            permitted = (size for size in sizes if _is_permitted(machine, _move(centre, k, size)))
            reach[side, k] = next(permitted, 0.0)
    random = np.random.default_rng(0)
    shares = random.uniform(-1, 1, (RANDOM_CANDIDATES, 6))
    tried = [_move(centre, k, reach[side, k]) for k in free for side in (0, 1)]
    tried += [centre + np.where(share < 0, -share * reach[0], share * reach[1]) for share in shares]
    # a pose that goes too far in several components at once is tried nearer to the centre
    tried += [
        centre + (pose - centre) / part for pose in tried[-RANDOM_CANDIDATES:] for part in (2, 4)
    ]
    steps = np.array([LENGTH_STEP] * 3 + [ANGLE_STEP] * 3)
    rounded = np.unique(np.rint(np.array(tried) / steps) + 0.0, axis=0) * steps
    return np.array([pose for pose in rounded if _is_permitted(machine, pose)]).reshape(-1, 6)


def _move(centre: Array, k: int, size: float) -> Array:
    moved = centre.copy()
    moved[k] += size
    return moved


def _pose(values: Array) -> Pose:
    return make_pose(values[..., :3], values[..., 3:])


def _is_permitted(machine: Machine, values: Array) -> bool:
    try:
        return bool(np.all(machine.check(machine.home * _pose(values)).ok))
    except MotionError:
        return False


def _find_rows(
    prediction: Prediction, theta: Array, poses: Array, rows: tuple[Array, Array, Array]
) -> Array:
    """Return rows (N, c, m) of the identification Jacobian at poses (N, 6); 0 if not closed."""
    weights, used, select = rows
    machine, vector = prediction.machine, prediction.vector
    further = whole_poses(_pose(poses), _pose(poses), name="proposed poses")
    whole = Prediction.from_measurements(machine, vector, further)
    jacobian = whole.at(theta)[1]
    if not np.isfinite(jacobian).all():  # one pose that does not close spoils all: find it
        jacobian = np.concatenate([_select_pose(whole, k).at(theta)[1] for k in range(len(poses))])
    return np.nan_to_num((jacobian * weights[:, None])[:, used.astype(bool)] @ select)


def _select_pose(whole: Prediction, k: int) -> Prediction:
    measurements, part = select_rows(whole.measurements, [k]), slice(k, k + 1)
    commanded = whole._commanded[part]
    return replace(whole, measurements=measurements, sent=whole.sent[part], _commanded=commanded)


def _choose_poses(known: Array, shown: Array) -> list[int]:
    """Choose poses by their rows (N, c, m), next to known rows (r, m); MAX_PROPOSED at most."""
    # without combinations that no pose shows, which would leave the determinant zero
    sizes, combinations = np.linalg.svd(np.concatenate([known, shown.reshape(-1, known.shape[1])]))[
        1:
    ]
    basis = combinations[sizes > MIN_SHARE * sizes[0]].T
    rows = shown @ basis
    information = (known @ basis).T @ (known @ basis)
    least = LEAST_INFORMATION * np.eye(len(information))
    chosen: list[int] = []
    while (
        len(chosen) < MAX_PROPOSED
        and _evenness(basis @ information @ basis.T, basis.shape[1]) < MIN_EVENNESS
    ):
        # det(A + RᵀR) = det A · det(1 + R A⁻¹ Rᵀ)
        gains = np.eye(rows.shape[1]) + rows @ np.linalg.inv(information + least) @ rows.transpose(
            0, 2, 1
        )
        best = int(np.linalg.slogdet(gains)[1].argmax())
        information = information + rows[best].T @ rows[best]
        chosen.append(best)
    return chosen


def _evenness(information: Array, rank: int) -> float:
    """Return O2 of a Jacobian J with JᵀJ = information, among the `rank` visible combinations."""
    length = np.sqrt(np.maximum(np.diag(information), LEAST_INFORMATION))
    sizes = np.linalg.eigvalsh(information / np.outer(length, length))[-rank:]
    return float(np.sqrt(max(sizes[0], 0.0) / sizes[-1]))
