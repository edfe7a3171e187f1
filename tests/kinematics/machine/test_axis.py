"""An axis is what it says, or it is refused."""

import numpy as np
import pytest

from kinematics import Axis, MotionError

CURVE = "two or more points"


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"name": 5}, "needs a name"),
        ({"name": ""}, "needs a name"),
        ({"kind": "foo"}, "kind 'foo' is neither"),
        ({"travel": 5}, "a: travel must be two numbers .*, not 5"),
        ({"travel": (0,)}, "a: travel must be two numbers"),
        ({"travel": None}, "a: travel must be two numbers .*, not None"),
        ({"travel": ("a", "b")}, "a: travel must be two numbers"),
        ({"travel": ((0, 1), 2)}, "a: travel must be two numbers"),
        ({"pulse": "a"}, "a: pulse must be one finite number in m above 0, not 'a'"),
        ({"pulse": None}, "a: pulse must be one finite number in m above 0, not None"),
        ({"direction": True}, "a: direction must be one finite number, not True"),
        ({"direction": 0.5}, "a: direction 0.5 is neither"),
        ({"max_speed": "1"}, r"a: max_speed \(None: unlimited; .*\) must be .* above 0, not '1'"),
        ({"max_force": (1.0, 2.0)}, "a: max_force .* must be one finite number"),
        ({"max_jerk": True}, "a: max_jerk .* must be finite"),
        ({"max_speed": (1.0, 2.0, 3.0)}, "a: max_speed .* must be finite numbers one or"),
        ({"max_speed": (1.0, 0.0)}, "a: max_speed .* above 0"),
        ({"resonance": "a"}, "a: resonance .* must be finite numbers"),
        ({"resonance": ((1.0, 2.0), (1.5, 3.0))}, "a: resonance .* rising and apart"),
        ({"backlash": -1.0}, "a: backlash .*not below 0, not -1"),
        ({"backlash": np.nan}, "a: backlash .*not nan"),
        ({"backlash": None}, "a: backlash .*not None"),
        (
            {"take_up_acceleration": 0.0},
            r"a: take_up_acceleration \(None: max_acceleration\) .* above 0, not 0",
        ),
        ({"lead_error": 5}, r"a: lead_error .* must be finite numbers \(N, 2\), not .*5"),
        ({"lead_error": ((0, 0),)}, f"a: lead_error .* must be {CURVE}"),
        (
            {"lead_error": ((1, 0), (0, 0))},
            f"a: lead_error .* must be {CURVE}, first values rising",
        ),
        ({"lead_error": ((0, np.nan), (1, 0))}, "a: lead_error .* must be finite numbers .*nan"),
        ({"torque_speed": ()}, "a: torque_speed .* must be finite numbers"),
        (
            {"torque_speed": ((1, 2), (0, 1))},
            f"a: torque_speed .* must be {CURVE}, first values rising",
        ),
        ({"torque_speed": ((0, -1), (1, 1))}, "a: torque_speed .*not below 0"),
        ({"card": "one"}, "a: card 'one' and channel None: give both"),
        ({"channel": 0}, "a: card None and channel 0: give both"),
        ({"card": 5, "channel": 0}, "a: card must be a name"),
        ({"card": "one", "channel": -1}, "a: channel must be a whole number, not below 0, not -1"),
        ({"card": "one", "channel": 1.5}, "a: channel must be a whole number"),
        ({"card": "one", "channel": True}, "a: channel must be a whole number"),
    ],
    ids=str,
)
def test_what_is_no_axis_is_refused(values, told):
    with pytest.raises(MotionError, match=told):
        Axis(**({"name": "a"} | values))


def test_what_was_given_as_arrays_cannot_be_changed_from_outside():
    travel, table = np.array([0.0, 1.0]), [[0.0, 0.0], [1.0, 1e-5]]
    axis = Axis(
        "a",
        travel=travel,
        lead_error=table,
        torque_speed=np.array([[0, 2], [1, 1]]),
        direction=-1.0,
    )
    travel[0] = table[0][0] = -5.0
    assert axis.travel == (0.0, 1.0)
    assert axis.lead_error == ((0.0, 0.0), (1.0, 1e-5))
    assert axis.torque_speed == ((0.0, 2.0), (1.0, 1.0))
    assert (axis.direction, type(axis.direction)) == (-1, int)
    assert {axis} == {
        Axis(
            "a",
            travel=(0, 1),
            lead_error=((0, 0), (1, 1e-5)),
            torque_speed=((0, 2), (1, 1)),
            direction=-1,
        )
    }
