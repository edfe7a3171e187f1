"""Tracking on a servo that the tests state: `leg_servo` behind every axis, unless another is
given.
"""

from controllers import Rig, tracking
from controllers.rig import assumed_rig


def track(motion, machine, law, *, servo=None, **options):
    """servo: one for all axes, or one per axis."""
    rig = assumed_rig(machine)
    if servo is not None:
        rig = Rig(
            machine, tuple(servo) if isinstance(servo, list) else (servo,) * len(machine.axes)
        )
    return tracking.track(motion, machine, law, rig=rig, **options)
