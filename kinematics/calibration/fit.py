"""The calibration of a machine: its parameters by least squares, and the machine that has them.

What the parameters are worth is told too, and what a further measurement would be, before it is
made.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from math import inf, nan, sqrt
from typing import Literal

import numpy as np

from kinematics.calibration.checks import select_reachable
from kinematics.calibration.measurement_file import MeasurementSource, load_measurements
from kinematics.calibration.measurements import AXIS, POSITION, Measurements, Noise, whole_poses
from kinematics.calibration.parameters import (
    DEFAULT,
    FreeParameter,
    FullVector,
    Prediction,
    free_parameters,
    full_vector,
    selection,
)
from kinematics.calibration.result import Calibration, Estimate, Observability, error_scale, observe
from kinematics.calibration.search import frame_start, minimize_errors
from kinematics.calibration.unseen import find_unseen
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.options import check_arguments
from kinematics.kinds.hexapod import Hexapod
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from kinematics.machine.machine_file import MachineSource, load_machine
from kinematics.machine.pose import Pose, from_numbers, to_numbers

BODY_KEYS = ("leg_radius", "leg_ends", "base_disc", "platform_disc")
"""What a hexapod says of the room that its parts take."""


def build_calibrated(prediction: Prediction, theta: Array) -> Machine:
    """The machine of a full vector (k,): pulse · factor, joints, and as home the pose that it takes
    at zero counts.

    Offsets need no place of their own: home_q = q(home) of that pose is the nominal q_home +
    offset. The measuring frame is no part of the machine. Raises MotionError where there is no pose
    at zero counts.
    """
    machine, vector = prediction.machine, prediction.vector
    for axis, factor in zip(machine.axes, theta[vector.factors()], strict=True):
        if factor <= 0:
            raise MotionError(
                f"machine {machine.name}: the measurements ask for a factor of {factor:.6g} on the pulse of "
                f"{axis.name}, which must be above 0; check units and signs of the file"
            )
    axes = [
        replace(axis, pulse=axis.pulse * float(factor))
        for axis, factor in zip(machine.axes, theta[vector.factors()], strict=True)
    ]
    offsets, joints = theta[vector.offsets()], theta[vector.joints()]
    home = machine.home
    if offsets.any() or (joints != vector.nominal[vector.joints()]).any():
        x = prediction.poses(theta, np.zeros((1, len(axes))), to_numbers(home))
        if not np.isfinite(x).all():
            raise MotionError(
                f"machine {machine.name}: it has no pose at zero counts with the identified parameters"
            )
        home = from_numbers(x[0])
    if isinstance(machine, Hexapod):
        return _hexapod(machine, joints.reshape(2, 6, 3), axes, home)
    moved = copy(machine)
    moved.name, moved.axes = f"{machine.name}-calibrated", tuple(axes)
    moved.home, moved.home_numbers = home, to_numbers(home)
    moved.home_q = freeze_array(machine.home_q + offsets)
    return moved


def _hexapod(machine: Hexapod, joints: Array, axes: list[Axis], home: Pose) -> Hexapod:
    return Hexapod(
        joints[0],
        joints[1],
        axes=axes,
        home=home,
        base_rest=machine.base_rest,
        platform_rest=machine.platform_rest,
        max_tilt=(float(machine.max_tilt[0]), float(machine.max_tilt[6])),
        name=f"{machine.name}-calibrated",
        load=machine.load,
        **(
            {}
            if machine.bodies is None
            else {key: getattr(machine.bodies, key) for key in BODY_KEYS}
        ),
    )


Use = Literal["position", "all"]
USES: dict[Use | None, int] = {"position": POSITION.stop, None: AXIS.start, "all": AXIS.stop}
"""How many of the components are fitted to, of those that were measured."""
# Errors of a start over those of the best one up to which it is tried too.
MAX_START_RATIO = 10.0
# Errors over those found before below which another minimum is the better one: less may be
# rounding.
MAX_IMPROVED_RATIO = 0.999
# Share of a pose's own weight in its fit, short of one, beyond which the other poses do not
# determine it.
MAX_LEVERAGE = 1 - 1e-9


def calibrate(
    machine: MachineSource,
    measured: MeasurementSource,
    parts: Sequence[str] = DEFAULT,
    *,
    use: Use | None = None,
    other_machine: bool = False,
) -> Calibration:
    """Identify a machine's parameters by maximum likelihood under the measurements' noise.

    Standard errors: of a stated noise, multiplied by `scale` where that exceeds 1 (the factor of
    the Particle Data Group); of a noise that is not stated, by `scale` itself, one radian of
    rotation counting as the machine's characteristic length. Combinations that the data do not show
    stay as they are at the nominal parameters, with the frame that carries commanded poses nearest
    to the measured ones.

    Parameters
    ----------
    machine, measured
        As they are, by name, or by the path of a file.
    parts
        Which parameters, see PARTS.
    use
        "position" or "all" that was measured. None: positions and rotations, not the direction of
        an axis alone, since
        that asks for a model of how the measuring frame is tilted.
    other_machine
        Fit measurements that state another machine's name, as of the same machine in a file of
        another name.

    Returns
    -------
    Calibration
        Parameters that never explain the data worse than the nominal ones, and the machine that has
        them. Checks that
        the machine cannot be sent to are left out, and named in `Calibration.skipped`.

    Raises
    ------
    MotionError
        A part is unknown, there are fewer values than parameters, the machine cannot be sent to
        fitted poses, the
        search does not converge, or measurements contradict the machine or are of another one.
    """
    machine, measured = load_machine(machine), load_measurements(measured)
    if not other_machine:
        _refuse_other(machine, measured)
    if use not in tuple(USES):  # which may be a list
        raise MotionError(f'calibrate: use {use!r} must be "position", "all" or None')
    vector = full_vector(machine)
    parameters = free_parameters(vector, parts)
    measured, skipped = select_reachable(machine, measured)
    chosen = _used_components(measured, use)
    if chosen.sum() < len(parameters):
        raise MotionError(
            f"{measured.name}: {count_noun(chosen.sum(), 'value')} of {count_noun(measured.fit.sum(), 'pose')} for "
            f"{count_noun(len(parameters), 'parameter')} "
            f"({', '.join(parts)}); measure more poses, or identify fewer parameters"
        )
    prediction, select = (
        Prediction.from_measurements(machine, vector, measured),
        selection(vector, parameters),
    )
    weights = weights_of(machine, measured)
    before, _ = prediction.at(vector.nominal)

    framed = np.array(vector.nominal)
    framed[vector.frame()] = frame_start(measured, chosen, parts)
    theta = _find_best(prediction, [framed, vector.nominal], weights, chosen, select)
    after, jacobian = prediction.at(theta)
    found = _find_observability(jacobian, weights, chosen, select, measured)

    degrees = int(chosen.sum()) - found.rank
    scale = _weighted_norm(after, weights, chosen) / sqrt(degrees) if degrees else nan
    unseen = find_unseen(
        prediction, theta, found, (weights, np.asarray(chosen.any(0), float), select)
    )
    widened = error_scale(measured.noise, scale)
    known = np.where(measured.seen, 1.0, np.nan)
    return Calibration(
        machine=build_calibrated(prediction, theta),
        nominal=machine,
        measurements=measured,
        parts=tuple(parts),
        parameters=_estimates(vector, parameters, theta, found, widened),
        observability=found,
        predicted=prediction.measured_poses(theta),
        before=freeze_array(before * known),
        after=freeze_array(after * known),
        left_out=freeze_array(
            _leave_one_out_errors(
                after, jacobian @ (select @ found.observable_changes), weights, chosen
            )
        ),
        used=freeze_array(chosen, bool),
        scale=scale,
        degrees=degrees,
        skipped=skipped,
        unseen=""
        if unseen is None
        else unseen.describe([parameter.name for parameter in parameters]),
    )


def _refuse_other(machine: Machine, measured: Measurements) -> None:
    """Raise MotionError for measurements that state another machine."""
    stated = measured.machine
    if stated and machine.name not in (stated, f"{stated}-calibrated"):
        raise MotionError(
            f'{measured.name} was measured on the machine "{stated}", and this is "{machine.name}"; give that machine, '
            "or, if it is the same one under another name, --other-machine (in Python: other_machine=True)"
        )


def _find_best(
    prediction: Prediction, starts: list[Array], weights: Array, chosen: np.ndarray, select: Array
) -> Array:
    """The full vector of least errors from the best start, or from another that is not far worse
    and leads to less: few data may have a minimum near each. Raises MotionError where none leads
    anywhere, of the best start.
    """

    def size(theta: Array) -> float:
        return _weighted_norm(prediction.at(theta)[0], weights, chosen)

    ordered = sorted(starts, key=size)
    best: Array | None = None
    refusal: MotionError | None = None
    tried: list[Array] = []
    for start in ordered:
        if size(start) > MAX_START_RATIO * size(ordered[0]) or any(
            (start == other).all() for other in tried
        ):
            continue
        tried.append(start)
        seen = _find_observability(
            prediction.at(start)[1], weights, chosen, select, prediction.measurements
        ).observable_changes
        try:
            theta = minimize_errors(prediction, start, weights, chosen, select @ seen)
        except MotionError as error:
            refusal = refusal or error
            continue
        if best is None or size(theta) < MAX_IMPROVED_RATIO * size(best):
            best = theta
    if best is None:
        raise refusal or MotionError(f"{prediction.measurements.name}: no start for the search")
    return best


def _used_components(measured: Measurements, use: Use | None) -> np.ndarray:
    return np.asarray(
        measured.seen & measured.fit[:, None] & (np.arange(measured.seen.shape[1]) < USES[use])
    )


def _weighted_norm(errors: Array, weights: Array, chosen: np.ndarray) -> float:
    return float(np.linalg.norm((errors * weights)[chosen]))


def weights_of(machine: Machine, measured: Measurements) -> Array:
    """(8,) 1 / the noise of each component; where it is not stated, a radian counts as the
    machine's own length.
    """
    noise = measured.noise or Noise(1.0, 1.0 / machine.characteristic_length)
    return np.array([1 / noise.position] * 3 + [1 / noise.rotation] * 5)


def _find_observability(
    jacobian: Array, weights: Array, chosen: np.ndarray, select: Array, measured: Measurements
) -> Observability:
    return observe((jacobian * weights[:, None])[chosen] @ select, int(measured.fit.sum()))


def _estimates(
    vector: FullVector,
    parameters: Sequence[FreeParameter],
    theta: Array,
    found: Observability,
    widened: float,
) -> tuple[Estimate, ...]:
    error = widened * np.sqrt((found.observable_changes**2).sum(1))
    return tuple(
        Estimate(
            parameter.name,
            parameter.unit,
            float(vector.nominal[parameter.moves[0]]),
            float(theta[parameter.moves[0]]),
            float(error[k]) if found.separate[k] else inf,
        )
        for k, parameter in enumerate(parameters)
    )


def _leave_one_out_errors(
    errors: Array, jacobian: Array, weights: Array, chosen: np.ndarray
) -> Array:
    """(I − H_kk)⁻¹ e_k of every pose, H the projection onto the fit's tangent space."""
    rows = jacobian * weights[:, None] * chosen[..., None]
    normal = np.linalg.inv(np.einsum("nia,nib->ab", rows, rows))
    left = np.full(errors.shape, np.nan)
    for k in np.flatnonzero(chosen.any(1)):
        entries = chosen[k]
        own = rows[k][entries]
        hat = own @ normal @ own.T
        if np.linalg.eigvalsh(hat)[-1] < MAX_LEVERAGE:
            alone = np.linalg.solve(np.eye(len(hat)) - hat, (errors[k] * weights)[entries])
            left[k, entries] = alone / weights[entries]
    return left


@check_arguments()
def foreseen_errors(calibration: Calibration, commanded: Pose) -> Array:
    """Predicted standard errors of the parameters if one of N further poses were measured, one at a
    time.

    They depend on where a pose is and not on what will be read there: Σ⁻¹ = Σ₀⁻¹ + Jᵀ W J of its
    errors' Jacobian J at the estimates, of the components that the calibration used and with its
    noise.

    Parameters
    ----------
    calibration
        Of the machine so far.
    commanded
        Batch of N poses, relative to the machine's home pose.

    Returns
    -------
    Array
        (N, m), of the m parameters; infinite where the pose does not identify the parameter either.

    Raises
    ------
    MotionError
        The machine cannot be sent to a pose.
    """
    machine, data = calibration.nominal, calibration.measurements
    vector = full_vector(machine)
    select = selection(vector, free_parameters(vector, calibration.parts))
    theta = vector.nominal + select @ [each.value - each.nominal for each in calibration.parameters]
    further = select_reachable(
        machine, whole_poses(commanded, commanded, name="further measurements")
    )[0]
    jacobian = Prediction.from_measurements(machine, vector, further).at(theta)[1]
    kept = calibration.used.any(0)
    rows = (jacobian * weights_of(machine, data)[:, None])[:, kept] @ select
    known = calibration.observability
    so_far = known.singular[:, None] * known.combinations / known.scale
    found = [observe(np.concatenate([so_far, own]), known.poses + 1) for own in rows]
    size = [
        np.where(each.separate, np.sqrt((each.observable_changes**2).sum(1)), np.inf)
        for each in found
    ]
    return freeze_array(error_scale(data.noise, calibration.scale) * np.array(size))
