from .cells import Cells as Cells
from .certify import (
    CROSSING as CROSSING,
    Certificate as Certificate,
    certify as certify,
)
from .conditioning import (
    Conditioning as Conditioning,
    find_poorest as find_poorest,
)
from .constant_speed import (
    CONSTANT_SPEED as CONSTANT_SPEED,
    SPEED_TOLERANCE as SPEED_TOLERANCE,
    Stretch as Stretch,
    find_stretches as find_stretches,
)
from .enclosure import (
    Enclosure as Enclosure,
    bound_polynomials as bound_polynomials,
    bound_series as bound_series,
    enclose as enclose,
)
from .feasibility import (
    Standing as Standing,
    find_singularity as find_singularity,
    prove_feasibility as prove_feasibility,
)
from .limit_use import (
    LIMIT_ROUNDING as LIMIT_ROUNDING,
    ProvedUse as ProvedUse,
    forget_paths as forget_paths,
    prove as prove,
    prove_path_use as prove_path_use,
    round_reached_use as round_reached_use,
)
from .path_enclosure import enclose_along_path as enclose_along_path
from .ranges import bound_motion as bound_motion
from .resonance_dwell import Stay as Stay, find_stays as find_stays
from .summary import join_certificates as join_certificates
