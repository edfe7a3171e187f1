"""The operator's console: any machine on the virtual card, by lines of text, from a keyboard or a remote computer."""

from controllers.console.links import Partial, TextLine
from controllers.console.serve import CONSOLE, Dispatcher, advance_time, drop_remote, take_line
from controllers.console.session import SavedSession, Session, open_session, snapshot_session

__all__ = [
    "CONSOLE",
    "Dispatcher",
    "Partial",
    "SavedSession",
    "Session",
    "TextLine",
    "advance_time",
    "drop_remote",
    "open_session",
    "snapshot_session",
    "take_line",
]
