"""The virtual motion card: models, commands, and the state that commands change."""

from controllers.card.change import PChange
from controllers.card.channels import Channels, Command
from controllers.card.home import Home
from controllers.card.interpolation import ArcMove, LinearMove
from controllers.card.model import PCI_8132, PCI_8164, SPEED_STEPS, Card, Refused
from controllers.card.profile import Profile
from controllers.card.record import Record, Train, play
from controllers.card.scurve import SAMove, SRMove
from controllers.card.state import CardState, at_rest, pulse_ticks, reading, send
from controllers.card.stop import DStop, Dwell, EStop
from controllers.card.together import Together
from controllers.card.trapezoid import TAMove, TRMove
from controllers.card.velocity import TVMove, VChange

__all__ = [
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
    "LinearMove",
    "PChange",
    "Profile",
    "Record",
    "Refused",
    "SAMove",
    "SRMove",
    "TAMove",
    "TRMove",
    "TVMove",
    "Together",
    "Train",
    "VChange",
    "at_rest",
    "play",
    "pulse_ticks",
    "reading",
    "send",
]
