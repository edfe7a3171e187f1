"""The command `pose`: what it prints, both ways, and how it ends."""

import json

import numpy as np
import pytest

from kinematics import load_machine


def told(call, *arguments, code=0):
    done = call("pose", *arguments, "--json")
    assert done.exit_code == code, done.stderr
    return json.loads(done.stdout)


def test_a_pose_and_back_by_lengths_travel_and_pulses(call):
    there = told(call, "hexapod", "5,5,35", "--turn", "3,-4,2")
    assert there["certified"] is there["ok"] is True
    assert there["pose"]["home"]["position_m"] == pytest.approx([5e-3, 5e-3, 35e-3], abs=1e-15)
    assert np.degrees(there["pose"]["home"]["angles_rad"]) == pytest.approx([3, -4, 2])
    assert (len(there["axes"]), len(there["joints"])) == (6, 12)
    for option, scale, key in (
        ("--lengths", 1e3, "position"),
        ("--travel", 1e3, "from_home"),
        ("--counts", 1, "pulses"),
    ):
        back = told(
            call, "hexapod", option, ",".join(str(scale * axis[key]) for axis in there["axes"])
        )
        off = 1e-5 if key == "pulses" else 1e-9
        assert back["pose"]["base"]["position_m"] == pytest.approx(
            there["pose"]["base"]["position_m"], abs=off
        )
        assert back["certified"]


def test_what_it_prints(call):
    printed = call("pose", "hexapod", "5,5,35", "--turn", "3,-4,2").stdout
    for part in (
        "α (°)",
        "leg6 platform joint",
        "length (mm)",
        "261.163635",
        "certified",
        "conditioning",
    ):
        assert part in printed


@pytest.mark.parametrize(
    ("arguments", "first"),
    [
        (
            ("hexapod", "500,0,0"),
            "NOT PERMITTED: leg2–leg3 clearance: they overlap by 8.909 mm and 31 more limits",
        ),
        (("traverser", "0,0,5000"), "NOT PERMITTED: Z travel: 5000 mm from home, outside"),
        (
            ("hexapod", "0,0,20"),
            "certified: the straight motion from home arrives in this pose and no other",
        ),
    ],
)
def test_what_is_said_first_is_whether_the_machine_may_take_the_pose(call, arguments, first):
    done = call("pose", *arguments)
    words = " ".join(done.stdout.split())
    assert " ".join(first.split()) in words
    assert words.index(first.split(":")[0]) < words.index("the axes")
    permitted = first.startswith("certified")
    assert done.exit_code == (0 if permitted else 1)
    assert ("certified:" in words) == permitted
    assert "limits kept" in words
    assert words.endswith("NO") != permitted


@pytest.mark.parametrize(
    "name", ["hexapod", "hexapod-initial", "tripod", "linkage", "traverser", "arm"]
)
def test_every_machine_has_its_home(call, name):
    if name == "arm":
        pytest.importorskip("pinocchio")
    machine = load_machine(name)
    for frame in ("home", "base"):
        found = told(call, name, "--frame", frame)
        assert [axis["position"] for axis in found["axes"]] == pytest.approx(
            machine.home_q.tolist(), abs=1e-12
        )
        assert {axis["pulses"] for axis in found["axes"]} == {0}
        assert found["certified"]


def test_units_may_be_said(call):
    inches = told(call, "traverser", "1 in, 2 in, 3 in", "--turn", "0, 0, 0.5 rad")
    assert [axis["from_home"] for axis in inches["axes"]] == pytest.approx(
        [0.0254, 0.0508, 0.0762, 0.5]
    )
    assert [axis["pulses"] for axis in inches["axes"][:3]] == [1600, 3200, 4800]


@pytest.mark.parametrize(
    ("arguments", "code", "phrase"),
    [
        (
            ["hexapod", "0,0,350"],
            1,
            "6 limits are violated, the worst is leg1 travel: 345.095 mm from home, outside",
        ),
        (
            ["tripod", "--lengths", "100,100,100"],
            1,
            "infeasible: machine tripod: no pose was found that has the lengths",
        ),
        (["tripod", "0,0,5", "--turn", "1,0,0"], 1, "holds rx: pose 0 has rx 1 deg off home"),
        (["hexapod", "5,5,x"], 2, "POSE: "),
        (
            ["hexapod", "1e30,0,0"],
            1,
            "infeasible: machine hexapod: leg1 would be 1.33e+33 pulses from home",
        ),
        (["hexapod", ""], 2, 'POSE "": 1 entry'),
        (["hexapod", "5,5,5 kg"], 2, "POSE: "),
        (
            ["hexapod", "-5,0,35", "--lengths", "1"],
            2,
            "--lengths beside a POSE: give a POSE, or one of --lengths",
        ),
        (
            ["hexapod", "--lengths", "1", "--counts", "1"],
            2,
            "--lengths and --counts: give a POSE, or one of",
        ),
        (["hexapod", "--counts", "1,2,3,4,5,6.5"], 2, '"6.5" is not a whole number of pulses'),
    ],
)
def test_how_it_ends(call, arguments, code, phrase):
    done = call("pose", *arguments)
    assert done.exit_code == code
    assert phrase in done.stderr


def test_what_follows_cannot_be_asked_for(call):
    pytest.importorskip("pinocchio")
    done = call("pose", "arm", "--turn", "1,0,0")
    assert done.exit_code == 2
    assert "rx follow from the rest of the pose" in done.stderr


def test_a_pose_beyond_a_singular_one_keeps_its_limits_and_is_refused(call, tmp_path):
    """However it is asked for: beyond the line of both rods, the same axes hold the platform
    another way.
    """
    from tests.planner.test_remedies import FIVE_BAR

    file = tmp_path / "fivebar.toml"
    file.write_text(FIVE_BAR)
    done = call("pose", file, "0,60,0")
    assert "NOT CERTIFIED" in done.stdout
    assert "limits kept" in done.stdout
    assert "infeasible: not certified: the straight motion from home" in done.stderr
    assert done.exit_code == 1
    assert call("pose", file, "0,50,0").exit_code == 0
    assert (
        "there is no position of left, right; bring it nearer to home, position 0, -90, 0 mm"
        in call("pose", file, "0,-150,0").stderr
    )
