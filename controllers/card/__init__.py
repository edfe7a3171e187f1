"""The virtual motion card: models, commands, and the state that commands change."""

from controllers.card.channels import Channels, Command
from controllers.card.model import COUNTER, PCI_8132, PCI_8164, SPEED_STEPS, Card, Refused
from controllers.card.profile import Profile
from controllers.card.state import CardState, at_rest, pulse_ticks, send
from controllers.card.trapezoid import TAMove, TRMove
from controllers.card.velocity import TVMove, VChange

__all__ = [
    "COUNTER",
    "PCI_8132",
    "PCI_8164",
    "SPEED_STEPS",
    "Card",
    "CardState",
    "Channels",
    "Command",
    "Profile",
    "Refused",
    "TAMove",
    "TRMove",
    "TVMove",
    "VChange",
    "at_rest",
    "pulse_ticks",
    "send",
]
