"""The search for the parameters of least error, and whether what it found is one.

It starts from where the measuring frame may stand, which may be turned by any angle.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from kinematics.calibration.measurements import POSITION, ROTATION, Measurements
from kinematics.calibration.parameters import XYZ, Prediction
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.units import describe, everyday_unit

FIRST_STEP_SHARE = 0.01
"""Share of the machine's size by which the first step may change the parameters together."""
MAX_EVALUATIONS = 5000
MAX_RELATIVE_OFFSET = 1e-3
"""Relative offset [Bates and Watts 1981] up to which a search counts as converged: along no
parameter would the errors fall by more than this share of what is left of them, degree of freedom
by degree of freedom.
"""
NEGLIGIBLE_ERROR = 1e-10
"""m or rad per component: smaller errors are none, so that they need not fall any further."""
MIN_EFFECT_SHARE = 1e-9
"""Share of the strongest effect below which a change of parameters has none: rounding."""


def minimize_errors(
    prediction: Prediction, start: Array, weights: Array, chosen: np.ndarray, basis: Array
) -> Array:
    """The full vector (k,) of least Σ (weight · error)² in start + the span of basis (k, r), from
    start.

    Errors are linear in the parameters as long as those change the machine little. So the trust
    region is a ball in changes over the size of the machine (`_sizes`), whatever the data show of
    them: a combination that is hardly seen asks for a long way, which the region lets it go in
    steps that the machine's own nonlinearity allows. Raises MotionError where the search does not
    converge, and where it ends in what contradicts the machine.
    """
    from scipy.optimize import least_squares

    if not basis.shape[1]:
        return start
    size = _sizes(prediction)[:, None]
    columns = basis / size
    steps = FIRST_STEP_SHARE * size * np.linalg.qr(columns / np.linalg.norm(columns, axis=0))[0]
    whole = float(np.linalg.norm((prediction.at(start)[0] * weights)[chosen])) or 1.0
    latest: dict[bytes, tuple[Array, Array]] = {}

    def evaluate(z: Array) -> tuple[Array, Array]:
        key = z.tobytes()
        if key not in latest:
            error, jacobian = prediction.at(start + steps @ z)
            # the optimiser asks for the derivatives where it has just asked for the errors
            latest.clear()
            latest[key] = (
                (error * weights)[chosen] / whole,
                (jacobian * weights[:, None])[chosen] @ steps / whole,
            )
        return latest[key]

    def errors(z: Array) -> Array:
        return evaluate(z)[0]

    def derivatives(z: Array) -> Array:
        return evaluate(z)[1]

    found = least_squares(
        errors,
        np.zeros(steps.shape[1]),
        jac=derivatives,
        method="trf",  # takes errors that are no numbers for a step too far
        xtol=1e-12,
        ftol=1e-12,
        gtol=None,  # gradients of what is hardly seen are small long before it is found
        max_nfev=MAX_EVALUATIONS,
    )
    theta = np.asarray(start + steps @ found.x)
    least = (
        NEGLIGIBLE_ERROR
        * float(np.linalg.norm(np.broadcast_to(weights, chosen.shape)[chosen]))
        / whole
    )
    _refuse_outliers(prediction, theta, chosen)
    if not _has_converged(errors(found.x), derivatives(found.x), least):
        _refuse_unfinished(prediction, start, theta, chosen, used_up=found.status <= 0)
    _refuse_displaced(prediction, theta)
    return theta


def _sizes(prediction: Prediction) -> Array:
    """(k,) the change of each entry of the full vector that is as large as the machine: its
    characteristic length for lengths, one for angles, and for factors what moves a sent coordinate
    by that.
    """
    machine, vector = prediction.machine, prediction.vector
    length = machine.characteristic_length
    axes = np.array([length if axis.kind == "linear" else 1.0 for axis in machine.axes])
    most = np.abs(prediction.sent).max(0)
    sizes = np.full(vector.size, length)
    sizes[vector.factors()] = axes / np.where(most > 0, most, axes)
    sizes[vector.offsets()] = axes
    sizes[vector.frame()][len(XYZ) :] = 1.0
    return sizes


def _has_converged(errors: Array, jacobian: Array, least: float) -> bool:
    """Whether what the tangent plane still promises is small beside what it cannot remove, or is
    nothing anyway.
    """
    change, _, rank, _ = np.linalg.lstsq(jacobian, errors, rcond=MIN_EFFECT_SHARE)
    promised, spare = jacobian @ change, len(errors) - int(rank)
    rest = float(np.linalg.norm(errors - promised)) * np.sqrt(rank / spare) if spare else 0.0
    return bool(np.linalg.norm(promised) <= max(MAX_RELATIVE_OFFSET * rest, least))


def _refuse_unfinished(
    prediction: Prediction, start: Array, theta: Array, chosen: np.ndarray, used_up: bool
) -> None:
    name = prediction.measurements.name
    before, after = (1e6 * _rms(prediction.at(vector)[0], chosen) for vector in (start, theta))
    progress = f"RMS position error {before:.6g} um at the start, {after:.6g} um at the end"
    if used_up:
        raise MotionError(
            f"{name}: the search for the parameters did not converge in {MAX_EVALUATIONS} evaluations ({progress}): "
            "the poses hardly determine some of them; identify fewer, or measure poses that are farther apart"
        )
    raise MotionError(
        f"{name}: the measurements contradict the machine {prediction.machine.name}: the search for parameters that "
        f"explain them ended where a pose becomes singular or out of reach ({progress}); check units, signs and home "
        "of the file, and that the machine is the one that was measured"
    )


def _rms(errors: Array, chosen: np.ndarray) -> float:
    known = errors[:, POSITION][chosen[:, POSITION]]
    return float(np.sqrt(np.mean(known**2))) if known.size else np.nan


def _refuse_outliers(prediction: Prediction, theta: Array, chosen: np.ndarray) -> None:
    """Raise MotionError where an error remains that is larger than the machine: that pose is none
    of it.
    """
    machine, data = prediction.machine, prediction.measurements
    length = machine.characteristic_length
    left = np.abs(np.where(chosen, prediction.at(theta)[0], 0.0))[:, POSITION].max(1)
    if left.max() > length:
        raise MotionError(
            f"{data.name}: {data.labels[int(left.argmax())]} contradicts the machine {machine.name}: with the best "
            f"parameters it is {describe(left.max(), everyday_unit('m'))} off, farther than the machine is large "
            f"({describe(length, everyday_unit('m'))}); check units, signs and home of the file, or leave that pose out"
        )


def _refuse_displaced(prediction: Prediction, theta: Array) -> None:
    """Raise MotionError where joints move by more than the machine's size: no such machine was
    built from the file.
    """
    vector, machine = prediction.vector, prediction.machine
    length = machine.characteristic_length
    moved = np.linalg.norm((theta - vector.nominal)[vector.joints()].reshape(-1, 3), axis=1)
    if moved.size and moved.max() > length:
        end, axis = divmod(int(moved.argmax()), len(vector.axes))
        what = f"{('base', 'platform')[end]} joint of {vector.axes[axis]} {describe(moved.max(), everyday_unit('m'))} away"
        raise MotionError(
            f"{prediction.measurements.name}: the measurements contradict the machine {machine.name}, or hardly show "
            f"the parameters: they ask for the {what} from where its file has it, farther than the machine is large "
            f"({describe(length, everyday_unit('m'))}); check units and signs, measure poses that are "
            "farther apart, or "
            "free fewer parameters"
        )


FLATNESS_SHARE = 1e-3
"""Second extent of a set of positions over its first, from which on they lie on a line and show no
turn about it.
"""


def frame_start(measured: Measurements, used: np.ndarray, parts: Sequence[str]) -> Array:
    """The frame x, y, z, rx, ry, rz that carries commanded poses nearest to the measured ones; zero
    where none is free.

    Its turn is the mean of those between commanded and measured rotations, or where these were not
    measured the one between the positions about their centres [Kabsch 1976]; none where the
    positions lie on a line.
    """
    rows = np.flatnonzero(used[:, POSITION].all(1))
    if not {"frame", "frame-yaw"} & set(parts) or not len(rows):
        return np.zeros(6)
    commanded, seen = measured.commanded[rows], measured.measured[rows]
    turn = _turn(commanded.translation, seen.translation, yaw="frame-yaw" in parts)
    whole = np.flatnonzero(used[:, ROTATION].all(1))
    if len(whole) and "frame" in parts:
        turn = (measured.measured[whole].rotation * measured.commanded[whole].rotation.inv()).mean()
    shift = seen.translation.mean(0) - turn.apply(commanded.translation.mean(0))
    return np.concatenate([shift, turn.as_euler("XYZ")])


def _turn(commanded: Array, seen: Array, yaw: bool) -> Rotation:
    a, b = commanded - commanded.mean(0), seen - seen.mean(0)
    if yaw:
        across, along = np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a[:, :2] * b[:, :2])
        return Rotation.from_euler("z", np.arctan2(across, along))
    extents = np.linalg.svd(a, compute_uv=False)
    if len(extents) < 3 or extents[1] < FLATNESS_SHARE * extents[0]:
        return Rotation.identity()
    return Rotation.align_vectors(b, a)[0]
