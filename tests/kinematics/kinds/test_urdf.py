"""Joints of a URDF by our own reader: pinocchio's to rounding, and machines that load without
it.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

from kinematics import FileError, load_machine
from kinematics.kinds.arm import read_urdf
from kinematics.kinds.urdf import read_joints

ARM = Path(__file__).parents[3] / "kinematics" / "presets" / "arm.urdf"
NAMES = ["yaw", "shoulder", "elbow"]
NONE = 'ixy="0" ixz="0" iyz="0"'
TURNED = f"""<robot name="turned"><link name="ground"/>
<link name="plate"><inertial><mass value="9"/><inertia ixx="1" iyy="1" izz="1" {NONE}/></inertial></link>
<joint name="bolt" type="fixed"><parent link="ground"/><child link="plate"/>
<origin xyz="0.1 -0.2 0.3" rpy="0.3 -0.4 0.5"/></joint>
<link name="column"><inertial><origin xyz="0.01 0.02 -0.05" rpy="0.7 0.1 -0.2"/><mass value="3"/>
<inertia ixx="0.01" iyy="0.012" izz="0.006" ixy="0.001" ixz="-0.0005" iyz="0.0002"/></inertial></link>
<link name="upper"/>
<link name="fore"><inertial><mass value="1.2"/><inertia ixx="0.01" iyy="0.01" izz="0.01" {NONE}/></inertial></link>
<link name="tool"><inertial><origin xyz="0 0 0.1"/><mass value="0.4"/>
<inertia ixx="0.002" iyy="0.002" izz="0.001" {NONE}/></inertial></link>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/>
<origin xyz="0.4 0 0.1" rpy="0 0.2 0"/><axis xyz="0 -3 4"/></joint>
<joint name="yaw" type="revolute"><parent link="plate"/><child link="column"/><origin xyz="0 0 0.2"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="shoulder" type="continuous"><parent link="column"/><child link="upper"/><origin rpy="1.1 0 0"/></joint>
<joint name="flange" type="fixed"><parent link="fore"/><child link="tool"/>
<origin xyz="0.35 0 0" rpy="0 0 0.9"/></joint></robot>"""


@pytest.mark.parametrize("turned", [False, True])
def test_both_readers_agree(turned, tmp_path):
    pytest.importorskip("pinocchio")
    path = tmp_path / "turned.urdf" if turned else ARM
    if turned:
        path.write_text(TURNED)
    ours, theirs = (read(path, NAMES, "tool") for read in (read_joints, read_urdf))
    for name in ("points", "directions", "tool", "tool_rotation"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=0, atol=1e-12)
    for mine, other in zip(ours.links, theirs.links, strict=True):
        for one, two in zip(mine, other, strict=True):
            np.testing.assert_allclose(one, two, rtol=0, atol=1e-12)


def test_the_bundled_arm_loads_without_pinocchio(monkeypatch):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    arm = load_machine("arm")
    q = arm.home_q + np.array([0.2, -0.1, 0.15])
    np.testing.assert_allclose(arm.inverse(arm.pose_of(q)), q, atol=1e-12)
    # [the preset's own dimensions] stretched out along x at q = 0: 0.4 m and 0.35 m, 0.2 m above
    # the base
    np.testing.assert_allclose(arm.pose_of(np.zeros(3)).translation, [0.75, 0.0, 0.2], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "names", "tool", "told"),
    [
        (
            ("", ""),
            ["yaw", "sholder", "elbow"],
            "tool",
            'no joint "sholder", nearest is "shoulder"; there are yaw',
        ),
        (("", ""), ["yaw", "elbow", "shoulder"], "tool", "do not follow each other"),
        (("", ""), ["yaw", "shoulder"], "tool", "wanted are three joints"),
        (("", ""), NAMES, "tol", 'no frame "tol", nearest is "tool"'),
        (
            ("", ""),
            NAMES,
            "upper",
            "frame 'upper' is carried by 'shoulder', not by the last joint 'elbow'",
        ),
        (("", ""), NAMES, "base", "is carried by nothing that moves"),
        (
            ('name="elbow" type="revolute"', 'name="elbow" type="prismatic"'),
            NAMES,
            "tool",
            "'elbow' does not turn",
        ),
        (('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>'), NAMES, "tool", "'yaw' has no axis"),
        (
            ('xyz="0.4 0 0"', 'xyz="0.4 0"'),
            NAMES,
            "tool",
            "joint elbow: xyz must be 3 finite numbers",
        ),
        (('xyz="0.4 0 0"', 'xyz="0.4 0 nan"'), NAMES, "tool", "xyz must be 3 finite numbers"),
        (('xyz="0.4 0 0"', 'xyz="4e9 0 0"'), NAMES, "tool", "within 1e"),
        ((' ixy="0"', ""), NAMES, "tool", "inertia ixy must be 1 finite number"),
        (('value="2.0"', 'value="two"'), NAMES, "tool", "mass value must be 1 finite number"),
        (('<parent link="upper"/>', ""), NAMES, "tool", "joint 'elbow' states no <parent"),
        (('<child link="fore"/>', '<child link="upper"/>'), NAMES, "tool", "no tree with one base"),
        (('<child link="fore"/>', '<child link="far"/>'), NAMES, "tool", "no tree with one base"),
        (
            ('<?xml version="1.0"?>', "<!DOCTYPE robot [<!ENTITY a 'b'>]>"),
            NAMES,
            "tool",
            "no document type",
        ),
        (("<robot", "<machine"), NAMES, "tool", "not XML"),
    ],
)
def test_what_is_no_arm_is_refused(change, names, tool, told, tmp_path):
    path = tmp_path / "odd.urdf"
    path.write_text(ARM.read_text().replace(*change, 1) if change[0] else ARM.read_text())
    with pytest.raises(FileError) as no:
        read_joints(path, names, tool)
    assert told in str(no.value)


GRIPPER = """<link name="left"/><link name="right"/>
<joint name="grip" type="prismatic"><parent link="tool"/><child link="left"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.04" effort="1" velocity="1"/></joint>
<joint name="follower" type="revolute"><parent link="column"/><child link="right"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.04" effort="1" velocity="1"/></joint></robot>"""


def _readers():
    try:
        import pinocchio  # noqa: F401
    except ImportError:
        return [read_joints]
    return [read_joints, read_urdf]


@pytest.mark.parametrize("reader", _readers())
def test_joints_that_move_besides_the_arms_are_named_with_the_remedy(reader, tmp_path):
    path = tmp_path / "gripper.urdf"
    path.write_text(ARM.read_text().replace("</robot>", GRIPPER))
    with pytest.raises(FileError) as refused:
        reader(path, NAMES, "tool")
    text = str(refused.value)
    assert "besides yaw, shoulder, elbow the file has 2 joints that move" in text
    assert '"grip" (prismatic), "follower" (revolute); give them type="fixed"' in text
    fixed = GRIPPER.replace('type="prismatic"', 'type="fixed"').replace(
        'type="revolute"', 'type="fixed"'
    )
    path.write_text(ARM.read_text().replace("</robot>", fixed))
    np.testing.assert_allclose(
        reader(path, NAMES, "tool").tool, reader(ARM, NAMES, "tool").tool, atol=1e-15
    )


@pytest.mark.parametrize("reader", _readers())
def test_joints_that_follow_others_are_refused(reader, tmp_path):
    path = tmp_path / "mimic.urdf"
    joint = '<joint name="elbow" type="revolute">'
    changed = ARM.read_text().replace(joint, joint + '<mimic joint="shoulder" multiplier="-1"/>')
    assert changed != ARM.read_text()
    path.write_text(changed)
    with pytest.raises(FileError, match='joint "elbow" follows "shoulder"'):
        reader(path, NAMES, "tool")


@pytest.mark.parametrize("reader", _readers())
@pytest.mark.parametrize(
    ("place", "name", "line"),
    [
        ('"elbow"', b'"el\rbow"', True), ('"tool"', b'"to&#13;ol"', False), ('"upper"', b'"up\nper"', True),
        ('"fore"', b'"fo\tre"', True), ('<robot name="', b'<robot name="a&#10;', False),
        ('"yaw"', '"y\u202eaw"'.encode(), True),
    ],
)  # fmt: skip
def test_names_that_cannot_be_shown_are_refused(reader, place, name, line, tmp_path):
    """XML turns a line end in a name into a blank, and pinocchio does not: the names would not be
    found.
    """
    raw = ARM.read_bytes()
    first = 1 + raw[: raw.index(place.encode())].count(b"\n")
    path = tmp_path / "odd.urdf"
    path.write_bytes(raw.replace(place.encode(), name))
    with pytest.raises(FileError, match="controls how text is shown") as refused:
        reader(path, NAMES, "tool")
    assert str(refused.value).startswith(f"{path}:{first}: ") == line


def test_a_machine_file_names_its_urdf_with_any_number_of_faults(tmp_path):
    raw = ARM.read_bytes().replace(b'"elbow"', b'"el\rbow"').replace(b'"upper"', b'"up\rper"')
    (tmp_path / "arm.urdf").write_bytes(raw)
    (tmp_path / "arm.toml").write_text((ARM.parent / "arm.toml").read_text())
    with pytest.raises(FileError, match=r"geometry\.urdf: .*arm\.urdf:\d+: name "):
        load_machine(tmp_path / "arm.toml")
