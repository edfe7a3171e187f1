"""What a further measurement would be worth, before it is made."""

import numpy as np

from kinematics.array import Array, frozen
from kinematics.calibration.fit import weights_of
from kinematics.calibration.measurements import whole_poses
from kinematics.calibration.observability import observe
from kinematics.calibration.parameters import free, full, selection
from kinematics.calibration.prediction import Prediction
from kinematics.calibration.reach import reachable
from kinematics.calibration.result import Calibration, widening
from kinematics.pose import Pose


def foreseen_errors(calibration: Calibration, commanded: Pose) -> Array:
    """Standard errors (N, m) of the parameters if one of N further poses were measured too, each on its own.

    They depend on where a pose is and not on what will be read there: Σ⁻¹ = Σ₀⁻¹ + Jᵀ W J of its errors' Jacobian J at
    the estimates, of the components that the calibration used and with its noise. A standard error stays infinite where
    the pose does not show the parameter apart either.

    commanded  relative to the machine's home pose. Raises MotionError for one that the machine cannot be sent to.
    """
    machine, data = calibration.nominal, calibration.measurements
    vector = full(machine)
    select = selection(vector, free(vector, calibration.parts))
    theta = vector.nominal + select @ [each.value - each.nominal for each in calibration.parameters]
    further = reachable(machine, whole_poses(commanded, commanded, name="further measurements"))[0]
    jacobian = Prediction.of(machine, vector, further).at(theta)[1]
    kept = calibration.used.any(0)
    rows = (jacobian * weights_of(machine, data)[:, None])[:, kept] @ select
    known = calibration.observability
    so_far = known.singular[:, None] * known.combinations / known.scale
    found = [observe(np.concatenate([so_far, own]), known.poses + 1) for own in rows]
    size = [np.where(each.separate, np.sqrt((each.seen**2).sum(1)), np.inf) for each in found]
    return frozen(widening(data.noise, calibration.scale) * np.array(size))
