from .fit import calibrate as calibrate, foreseen_errors as foreseen_errors
from .measurements import (
    Measurements as Measurements,
    Noise as Noise,
    measured_positions as measured_positions,
    whole_poses as whole_poses,
)
from .result import Observability as Observability
from .parameters import DEFAULT as DEFAULT, PARTS as PARTS, calibration_parts as calibration_parts
from .result import Calibration as Calibration, Estimate as Estimate
