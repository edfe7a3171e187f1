from .checking import check as check
from .checking.edge_reader import check_file as check_file
from .checking.pulse_reader import (
    PulseFile as PulseFile,
    open_pulses as open_pulses,
    read_pulses as read_pulses,
)
from .checking.verdict import (
    AxisCheck as AxisCheck,
    PulseCheck as PulseCheck,
    PulseFault as PulseFault,
)
from .compression import compress as compress
from .generation.generate import (
    find_rule as find_rule,
    generate as generate,
    pace_axes as pace_axes,
)
from .generation.rules import RULES as RULES
from .generation.firing_rule import Rule as Rule
from .generation.stream import PulseStream as PulseStream
from .motion import AxesMotion as AxesMotion, MotionState as MotionState
from .realised_path import (
    RealisedError as RealisedError,
    RealisedPath as RealisedPath,
    realised as realised,
)
from .schedule import (
    AxisPulses as AxisPulses,
    MovedPulses as MovedPulses,
    PulseSchedule as PulseSchedule,
)
from .compression import StepQueue as StepQueue, decompress as decompress
