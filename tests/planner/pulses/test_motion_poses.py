"""The poses that pulses have reached: by hand from the counts, and inside what the realised path is
bounded by.
"""

import numpy as np
import pytest

from kinematics import MotionError, load_machine
from kinematics.machine.pose import to_numbers
from planner import PulseSchedule, load_program, plan, realised
from planner.pulses.motion import find_reached_poses

OVER = """schema = 1
length = "mm"
[[segment]]
line = { to = [40, 30, 20] }
[[segment]]
line = { to = [5, 10, 0] }
"""


@pytest.fixture(scope="module")
def circle(planned):
    return planned("bare-circle", 2)


@pytest.fixture(scope="module")
def playing(tmp_path_factory):
    """On the traverser, whose axes state play and lead error, and turn on the way."""
    file = tmp_path_factory.mktemp("programs") / "over.toml"
    file.write_text(OVER)
    return plan(load_program(str(file)), load_machine("traverser"))


def planned_at(plan, t):
    return to_numbers(plan.trajectory.at(t).pose)


def test_without_play_it_is_the_pose_of_the_counts(circle):
    t = np.linspace(0, circle.trajectory.duration, 50)
    found = find_reached_poses(circle.machine, circle.pulses, t, planned_at(circle, t))
    q = circle.machine.home_q + circle.pulses.counts(t) * [
        axis.pulse for axis in circle.pulses.axes
    ]
    lengths = [
        np.linalg.norm(
            x[:3] + circle.machine.platform @ x[3:].reshape(3, 3).T - circle.machine.base, axis=1
        )
        for x in found
    ]
    np.testing.assert_allclose(lengths, q, atol=1e-9)  # what forward kinematics leaves


@pytest.mark.parametrize("which", ["circle", "playing"])
def test_its_errors_are_those_of_the_realised_path(which, request):
    plan = request.getfixturevalue(which)
    # just after pulses, where `realised` looks too
    fired = np.sort(np.concatenate([axis.ticks for axis in plan.pulses.axes]))
    t = fired[:: max(1, len(fired) // 2000)] / plan.pulses.clock_hz
    x = planned_at(plan, t)
    errors = np.linalg.norm(
        find_reached_poses(plan.machine, plan.pulses, t, x)[:, :3] - x[:, :3], axis=1
    )
    known = realised(plan)["position"]
    assert errors.max() <= known.max * (1 + 1e-6)
    window = np.searchsorted(realised(plan).edges, t, side="right") - 1
    assert (
        errors <= known.series[np.minimum(window, len(known.series) - 1)] * (1 + 1e-6) + 1e-12
    ).all()


def test_play_is_behind_where_the_axes_turn(playing):
    """X runs 40 mm out and 35 mm back: pushed from below going out, from above coming back, 0.002
    in apart.
    """
    t = np.array([playing.trajectory.duration])
    (x,) = find_reached_poses(playing.machine, playing.pulses, t, planned_at(playing, t))
    axis = playing.machine.axes[0]
    lead = np.interp(5e-3 + axis.backlash, *np.array(axis.lead_error).T)
    assert x[0] == pytest.approx(5e-3 + axis.backlash + lead, abs=axis.pulse)
    assert axis.backlash > 3 * axis.pulse  # the play is seen


def test_counts_of_another_motion_are_refused(circle):
    far = tuple(
        type(axis)(
            axis.name,
            axis.ticks,
            axis.direction,
            axis.start + 10**6 * (n % 2),
            axis.pulse,
            axis.home,
        )
        for n, axis in enumerate(circle.pulses.axes)
    )
    schedule = PulseSchedule(circle.pulses.clock_hz, far, circle.pulses.duration)
    with pytest.raises(MotionError, match="stand for no pose"):
        find_reached_poses(
            circle.machine, schedule, np.array([0.1]), planned_at(circle, np.array([0.1]))
        )
