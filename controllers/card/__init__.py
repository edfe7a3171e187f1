"""The virtual motion card: models, commands, and the state that commands change."""

from controllers.card.channels import Channels, Command
from controllers.card.home import HomeMode, HomeReturn
from controllers.card.interpolation import ArcMove, LinearMove
from controllers.card.model import PCI_8132, PCI_8164, SPEED_STEPS, Card, Refused
from controllers.card.profile import MoveProfile
from controllers.card.record import OUTPUT_MODES, Record, Train, Wires, play, wires
from controllers.card.scurve import SAMove, SRMove, SVMove
from controllers.card.start_and_stop import DStop, DwellMove, EStop, Together
from controllers.card.state import CardState, at_rest, current_speed, pulse_ticks, read_counters, send
from controllers.card.trapezoid import TAMove, TRMove
from controllers.card.velocity import PChange, TVMove, VChange

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
    "DwellMove",
    "EStop",
    "HomeMode",
    "HomeReturn",
    "LinearMove",
    "MoveProfile",
    "PChange",
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
    "read_counters",
    "send",
    "wires",
]
