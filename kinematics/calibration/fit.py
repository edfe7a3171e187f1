"""Least squares over the parameters of a model, and what the result is worth."""

from collections.abc import Sequence
from math import inf, nan, sqrt
from typing import Literal

import numpy as np

from kinematics.array import Array, frozen
from kinematics.calibration.alignment import frame_start
from kinematics.calibration.calibrated import calibrated
from kinematics.calibration.measurements import POSITION, Measurements, Noise
from kinematics.calibration.observability import Observability, observe
from kinematics.calibration.parameters import DEFAULT, Free, Full, free, full, selection
from kinematics.calibration.prediction import Prediction
from kinematics.calibration.result import Calibration, Estimate
from kinematics.errors import MotionError
from kinematics.machine import Machine

Use = Literal["position", "all"]
# Share of a pose's own weight in its fit, short of one, beyond which the other poses do not determine it.
DETERMINED = 1 - 1e-9

SINGULAR = 1e9
"""Motion of the platform over that of an axis (m, rad) from which on a pose is singular to rounding."""


def calibrate(
    machine: Machine, measured: Measurements, parts: Sequence[str] = DEFAULT, *, use: Use | None = None
) -> Calibration:
    """Identify the parameters of `parts` (see PARTS): maximum likelihood under the measurements' noise.

    use  "position" or "all" that was measured; None: all where whole poses were measured, else positions, since the
         direction of an axis alone asks for a model of how the measuring frame is tilted

    Standard errors: of a stated noise, multiplied by `scale` where that exceeds 1 (the factor of the Particle Data
    Group); of a noise that is not stated, by `scale` itself, one radian of rotation counting as the machine's
    characteristic length. Combinations that the data do not show stay as they are at the nominal parameters, with the
    frame that carries commanded poses nearest to the measured ones.
    Raises MotionError for an unknown part, fewer values than parameters, and poses the machine cannot take.
    """
    vector = full(machine)
    parameters = free(vector, parts)
    chosen = _used(measured, use)
    if chosen.sum() < len(parameters):
        raise MotionError(
            f"{measured.name}: {measured.fit.sum()} poses give {chosen.sum()} values for {len(parameters)} parameters "
            f"({', '.join(parts)}); measure more poses, or free fewer parameters"
        )
    prediction, select = Prediction.of(machine, vector, measured), selection(vector, parameters)
    weights = _weights(measured.noise or Noise(1.0, 1.0 / machine.characteristic_length))
    before, jacobian = prediction.at(vector.nominal)
    if not np.isfinite(jacobian).all() or np.abs(jacobian).max() > SINGULAR:
        raise MotionError(f"machine {machine.name}: singular at a commanded pose of {measured.name}; leave that out")

    start = np.array(vector.nominal)
    start[vector.frame()] = frame_start(measured, chosen, parts)
    _, jacobian = prediction.at(start)
    basis = select @ _observed(jacobian, weights, chosen, select, measured).seen
    theta = _least_squares(prediction, start, weights, chosen, basis)
    after, jacobian = prediction.at(theta)
    found = _observed(jacobian, weights, chosen, select, measured)

    degrees = int(chosen.sum()) - found.rank
    scale = sqrt(float(((after * weights)[chosen] ** 2).sum()) / degrees) if degrees else nan
    widened = scale if measured.noise is None else max(1.0, 0.0 if degrees == 0 else scale)
    known = np.where(measured.seen, 1.0, np.nan)
    return Calibration(
        machine=calibrated(prediction, theta),
        nominal=machine,
        measurements=measured,
        parts=tuple(parts),
        parameters=_estimates(vector, parameters, theta, found, widened),
        observability=found,
        predicted=prediction.seen(theta),
        before=frozen(before * known),
        after=frozen(after * known),
        left_out=frozen(_left_out(after, jacobian @ (select @ found.seen), weights, chosen)),
        used=frozen(chosen, bool),
        scale=scale,
        degrees=degrees,
    )


def _used(measured: Measurements, use: Use | None) -> np.ndarray:
    chosen = measured.seen & measured.fit[:, None]
    if use == "position" or (use is None and not measured.whole):
        chosen = chosen & (np.arange(chosen.shape[1]) < POSITION.stop)
    return np.asarray(chosen)


def _weights(noise: Noise) -> Array:
    return np.array([1 / noise.position] * 3 + [1 / noise.rotation] * 5)


def _observed(
    jacobian: Array, weights: Array, chosen: np.ndarray, select: Array, measured: Measurements
) -> Observability:
    return observe((jacobian * weights[:, None])[chosen] @ select, int(measured.fit.sum()))


def _least_squares(prediction: Prediction, start: Array, weights: Array, chosen: np.ndarray, basis: Array) -> Array:
    """The full vector start + basis · z of least errors; the basis' columns have independent effects of length 1."""
    from scipy.optimize import least_squares

    # in units of the whole error, the step that would remove it is within the optimiser's first trust region of 1
    size = float(np.linalg.norm((prediction.at(start)[0] * weights)[chosen])) or 1.0
    latest: dict[bytes, tuple[Array, Array]] = {}

    def evaluated(z: Array) -> tuple[Array, Array]:
        key = z.tobytes()
        if key not in latest:
            error, jacobian = prediction.at(start + size * basis @ z)
            latest.clear()  # the optimiser asks for the derivatives where it has just asked for the errors
            latest[key] = (error * weights)[chosen] / size, (jacobian * weights[:, None])[chosen] @ basis
        return latest[key]

    def errors(z: Array) -> Array:
        return evaluated(z)[0]

    def derivatives(z: Array) -> Array:
        return evaluated(z)[1]

    found = least_squares(
        errors,
        np.zeros(basis.shape[1]),
        jac=derivatives,
        method="trf",
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
        max_nfev=200,
    )
    if found.status <= 0:
        raise MotionError(
            f"{prediction.measurements.name}: no parameters were found that explain the measurements; "
            "check units and signs of the file, or free fewer parameters"
        )
    return np.asarray(start + size * basis @ found.x)


def _estimates(
    vector: Full, parameters: Sequence[Free], theta: Array, found: Observability, widened: float
) -> tuple[Estimate, ...]:
    error = widened * np.sqrt((found.seen**2).sum(1))
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


def _left_out(errors: Array, jacobian: Array, weights: Array, chosen: np.ndarray) -> Array:
    """(I − H_kk)⁻¹ e_k of every pose, H the projection onto the fit's tangent space."""
    rows = jacobian * weights[:, None] * chosen[..., None]
    normal = np.linalg.inv(np.einsum("nia,nib->ab", rows, rows))
    left = np.full(errors.shape, np.nan)
    for k in np.flatnonzero(chosen.any(1)):
        entries = chosen[k]
        own = rows[k][entries]
        hat = own @ normal @ own.T
        if np.linalg.eigvalsh(hat)[-1] < DETERMINED:
            alone = np.linalg.solve(np.eye(len(hat)) - hat, (errors[k] * weights)[entries])
            left[k, entries] = alone / weights[entries]
    return left
