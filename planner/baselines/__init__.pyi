from .classical import (
    Classical as Classical,
    KINDS as KINDS,
    classical as classical,
    describe_differences as describe_differences,
    missing_limits as missing_limits,
    pick_baseline as pick_baseline,
)
from .moves import Deviation as Deviation
