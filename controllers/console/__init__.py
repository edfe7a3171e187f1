"""The operator's console: any machine on the virtual card, by lines of text, from a keyboard or a remote computer."""

from controllers.console.desk import CONSOLE, Desk, gone, heard, passed
from controllers.console.lines import Line, Partial
from controllers.console.session import Saved, Session, opened, saved

__all__ = ["CONSOLE", "Desk", "Line", "Partial", "Saved", "Session", "gone", "heard", "opened", "passed", "saved"]
