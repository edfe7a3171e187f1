from .channels import Channels as Channels, Command as Command
from .home import HomeMode as HomeMode, HomeReturn as HomeReturn
from .interpolation import ArcMove as ArcMove, LinearMove as LinearMove
from .model import (
    Card as Card,
    PCI_8132 as PCI_8132,
    PCI_8164 as PCI_8164,
    Refused as Refused,
    SPEED_STEPS as SPEED_STEPS,
)
from .profile import MoveProfile as MoveProfile
from .record import (
    Record as Record,
    Train as Train,
    Wires as Wires,
    play as play,
    wires as wires,
)
from .scurve import SAMove as SAMove, SRMove as SRMove, SVMove as SVMove
from .start_and_stop import (
    DStop as DStop,
    DwellMove as DwellMove,
    EStop as EStop,
    Together as Together,
)
from .state import (
    CardState as CardState,
    at_rest as at_rest,
    current_speed as current_speed,
    read_counters as read_counters,
    send as send,
)
from .trapezoid import TAMove as TAMove, TRMove as TRMove
from .trapezoid import PChange as PChange, TVMove as TVMove, VChange as VChange
