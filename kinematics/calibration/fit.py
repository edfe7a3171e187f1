"""The calibration of a machine: its parameters by least squares, and what they are worth."""

from collections.abc import Sequence
from math import inf, nan, sqrt
from typing import Literal

import numpy as np

from kinematics.array import Array, frozen
from kinematics.calibration.alignment import frame_start
from kinematics.calibration.calibrated import calibrated
from kinematics.calibration.measurements import AXIS, POSITION, Measurements, Noise
from kinematics.calibration.observability import Observability, observe
from kinematics.calibration.parameters import DEFAULT, Free, Full, free, full, selection
from kinematics.calibration.prediction import Prediction
from kinematics.calibration.reach import reachable
from kinematics.calibration.result import Calibration, Estimate, widening
from kinematics.calibration.search import least_errors
from kinematics.errors import MotionError
from kinematics.machine import Machine

Use = Literal["position", "all"]
USES: dict[Use | None, int] = {"position": POSITION.stop, None: AXIS.start, "all": AXIS.stop}
"""How many of the components are fitted to, of those that were measured."""
# Errors of a start over those of the best one up to which it is tried too.
OTHER_START = 10.0
# Errors over those found before below which another minimum is the better one: less may be rounding.
BETTER = 0.999
# Share of a pose's own weight in its fit, short of one, beyond which the other poses do not determine it.
DETERMINED = 1 - 1e-9


def calibrate(
    machine: Machine, measured: Measurements, parts: Sequence[str] = DEFAULT, *, use: Use | None = None
) -> Calibration:
    """Identify the parameters of `parts` (see PARTS): maximum likelihood under the measurements' noise.

    use  "position" or "all" that was measured; None: positions and rotations, not the direction of an axis alone,
         since that asks for a model of how the measuring frame is tilted

    Standard errors: of a stated noise, multiplied by `scale` where that exceeds 1 (the factor of the Particle Data
    Group); of a noise that is not stated, by `scale` itself, one radian of rotation counting as the machine's
    characteristic length. Combinations that the data do not show stay as they are at the nominal parameters, with the
    frame that carries commanded poses nearest to the measured ones.
    Checks that the machine cannot be sent to are left out, and named in `Calibration.skipped`. Raises MotionError for
    an unknown part, fewer values than parameters, fitted poses that the machine cannot be sent to, a search that does
    not converge, and measurements that contradict the machine; never gives parameters that explain them worse.
    """
    _known(machine, measured, use)
    vector = full(machine)
    parameters = free(vector, parts)
    measured, skipped = reachable(machine, measured)
    chosen = _used(measured, use)
    if chosen.sum() < len(parameters):
        raise MotionError(
            f"{measured.name}: {measured.fit.sum()} poses give {chosen.sum()} values for {len(parameters)} parameters "
            f"({', '.join(parts)}); measure more poses, or free fewer parameters"
        )
    prediction, select = Prediction.of(machine, vector, measured), selection(vector, parameters)
    weights = weights_of(machine, measured)
    before, _ = prediction.at(vector.nominal)

    framed = np.array(vector.nominal)
    framed[vector.frame()] = frame_start(measured, chosen, parts)
    theta = _best(prediction, [framed, vector.nominal], weights, chosen, select)
    after, jacobian = prediction.at(theta)
    found = _observed(jacobian, weights, chosen, select, measured)

    degrees = int(chosen.sum()) - found.rank
    scale = _size(after, weights, chosen) / sqrt(degrees) if degrees else nan
    widened = widening(measured.noise, scale)
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
        skipped=skipped,
    )


def _best(prediction: Prediction, starts: list[Array], weights: Array, chosen: np.ndarray, select: Array) -> Array:
    """The full vector of least errors from the best start, or from another that is not far worse and leads to less:
    few data may have a minimum near each. Raises MotionError where none leads anywhere, of the best start."""

    def size(theta: Array) -> float:
        return _size(prediction.at(theta)[0], weights, chosen)

    ordered = sorted(starts, key=size)
    best: Array | None = None
    refusal: MotionError | None = None
    tried: list[Array] = []
    for start in ordered:
        if size(start) > OTHER_START * size(ordered[0]) or any((start == other).all() for other in tried):
            continue
        tried.append(start)
        seen = _observed(prediction.at(start)[1], weights, chosen, select, prediction.measurements).seen
        try:
            theta = least_errors(prediction, start, weights, chosen, select @ seen)
        except MotionError as error:
            refusal = refusal or error
            continue
        if best is None or size(theta) < BETTER * size(best):
            best = theta
    if best is None:
        raise refusal or MotionError(f"{prediction.measurements.name}: no start for the search")
    return best


def _known(machine: object, measured: object, use: object) -> None:
    for value, kind, remedy in (
        (machine, Machine, "load_machine reads a file"),
        (measured, Measurements, "load_measurements reads a file, whole_poses takes arrays"),
    ):
        if not isinstance(value, kind):
            raise MotionError(f"calibrate: {value!r} is no {kind.__name__}; {remedy}")
    if use not in USES:
        raise MotionError(f'calibrate: use {use!r} must be "position", "all" or None')


def _used(measured: Measurements, use: Use | None) -> np.ndarray:
    return np.asarray(measured.seen & measured.fit[:, None] & (np.arange(measured.seen.shape[1]) < USES[use]))


def _size(errors: Array, weights: Array, chosen: np.ndarray) -> float:
    return float(np.linalg.norm((errors * weights)[chosen]))


def weights_of(machine: Machine, measured: Measurements) -> Array:
    """(8,) 1 / the noise of each component; where it is not stated, a radian counts as the machine's own length."""
    noise = measured.noise or Noise(1.0, 1.0 / machine.characteristic_length)
    return np.array([1 / noise.position] * 3 + [1 / noise.rotation] * 5)


def _observed(
    jacobian: Array, weights: Array, chosen: np.ndarray, select: Array, measured: Measurements
) -> Observability:
    return observe((jacobian * weights[:, None])[chosen] @ select, int(measured.fit.sum()))


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
