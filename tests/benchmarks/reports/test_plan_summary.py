"""The summary names the limits that were not checked."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reports.plan_content import PlanReport
from benchmarks.reports.plan_summary import summarise
from kinematics import Hexapod, load_machine
from planner import Line, Program, check, plan

LIFT = Program([Line([0, 0, 0.01])])
OUTSIDE = "tool, workpiece and surroundings"


def unchecked(machine):
    rows = {row.label: row for row in summarise(PlanReport(plan(LIFT, machine, order=2)))}
    assert rows["not checked"].brief
    return rows["not checked"].text


def test_the_limits_that_the_machine_leaves_out_are_not_checked():
    machine = load_machine("hexapod")
    assert unchecked(machine) == f"collisions with {OUTSIDE}, jerk"
    axes = [replace(axis, max_force=None) for axis in machine.axes]
    bare = Hexapod(machine.base, machine.platform, axes=axes, home=machine.home)
    assert unchecked(bare) == "collisions, tilt of the joints, forces and torques, jerk"
    legs = Hexapod(
        machine.base, machine.platform, axes=axes, home=machine.home, leg_radius=0.01, max_tilt=1.0
    )
    assert (
        unchecked(legs)
        == f"collisions with plates without a disc, {OUTSIDE}, forces and torques, jerk"
    )


@pytest.mark.parametrize(
    ("max_tilt", "use"),
    [(None, None), ((1.0, None), "base"), ((None, 1.0), "platform"), (1.0, "base")],
)
def test_an_unlimited_tilt_is_no_limit(max_tilt, use):
    """Neither of all joints nor of those at one end; the tilt of the others is bounded as
    before.
    """
    hexapod = load_machine("hexapod")
    machine = Hexapod(
        hexapod.base, hexapod.platform, axes=hexapod.axes, home=hexapod.home, max_tilt=max_tilt
    )
    largest = check(LIFT, machine).largest
    assert ("tilt" in largest) == (use is not None)
    if use is not None:
        ratio, place = largest["tilt"]
        assert place.axis.endswith(f"{use} joint")
        ends = {"base": slice(6), "platform": slice(6, 12)}
        cosines = np.asarray(machine.tilt_map(machine.home_numbers)).ravel()
        assert ratio >= np.arccos(cosines[ends[use]]).max() - 1e-9
