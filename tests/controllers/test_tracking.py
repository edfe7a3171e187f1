"""The motion that tracking follows."""

from dataclasses import replace

from controllers.tracking import motion_of
from kinematics import load_machine
from kinematics.machine.shaper import Shaper
from planner import Line, Program, plan


def test_a_shaped_plan_is_tracked_as_it_is_shaped():
    machine = load_machine("hexapod")
    machine = machine.driven_by([replace(axis, shaper=Shaper("zv", 20.0)) for axis in machine.axes])
    made = plan(Program((Line((0.0, 0.0, 0.002)),)), machine, order=2)
    assert motion_of(made) is made.shaped.motion
    assert motion_of(made.trajectory) is made.trajectory
