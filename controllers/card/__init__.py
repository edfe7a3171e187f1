"""The virtual motion card: models, commands, and the state that commands change."""

from controllers.card.change import PChange
from controllers.card.channels import Channels, Command
from controllers.card.home import Home
from controllers.card.home_modes import HomeMode
from controllers.card.interpolation import ArcMove, LinearMove
from controllers.card.model import PCI_8132, PCI_8164, SPEED_STEPS, Card, Refused
from controllers.card.output import OUTPUT_MODES, Wires, wires
from controllers.card.profile import Profile
from controllers.card.record import Record, Train, play
from controllers.card.scurve import SAMove, SRMove, SVMove
from controllers.card.state import CardState, at_rest, current_speed, pulse_ticks, reading, send
from controllers.card.stop import DStop, Dwell, EStop
from controllers.card.together import Together
from controllers.card.trapezoid import TAMove, TRMove
from controllers.card.velocity import TVMove, VChange

__all__ = [
    "OUTPUT_MODES",
    "PCI_8132",
    "PCI_8164",
    "SPEED_STEPS",
    "ArcMove",
    "Card",
    "CardState",
    "Channels",
    "Command",
    "DStop",
    "Dwell",
    "EStop",
    "Home",
    "HomeMode",
    "LinearMove",
    "PChange",
    "Profile",
    "Record",
    "Refused",
    "SAMove",
    "SRMove",
    "SVMove",
    "TAMove",
    "TRMove",
    "TVMove",
    "Together",
    "Train",
    "VChange",
    "Wires",
    "at_rest",
    "current_speed",
    "play",
    "pulse_ticks",
    "reading",
    "send",
    "wires",
]
