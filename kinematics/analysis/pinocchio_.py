"""What all uses of pinocchio share: its import, where it is installed, and bodies as its inertias."""

from typing import Any

from kinematics.foundation.errors import NotInstalled
from kinematics.machine.load import Body


def pinocchio(what: str) -> Any:
    """The module. Raises NotInstalled, naming what needs it, where it is not installed."""
    try:
        import pinocchio
    except ImportError as missing:
        raise NotInstalled(what, "pin (pinocchio)") from missing
    return pinocchio


def inertia(body: Body) -> Any:
    """pinocchio's spatial inertia of a body, in the body's frame."""
    return pinocchio("an inertia").Inertia(body.mass, body.centre, body.inertia)
