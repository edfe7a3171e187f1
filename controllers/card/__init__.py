"""The virtual motion card: models, commands, and the state that commands change."""

from controllers.card.commands import Command, TAMove, TRMove
from controllers.card.model import COUNTER, PCI_8132, PCI_8164, SPEED_STEPS, Card, Refused
from controllers.card.profile import Profile
from controllers.card.state import CardState, at_rest, pulse_ticks, send

__all__ = [
    "COUNTER",
    "PCI_8132",
    "PCI_8164",
    "SPEED_STEPS",
    "Card",
    "CardState",
    "Command",
    "Profile",
    "Refused",
    "TAMove",
    "TRMove",
    "at_rest",
    "pulse_ticks",
    "send",
]
