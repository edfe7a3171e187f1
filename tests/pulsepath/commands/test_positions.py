"""The command `positions`: lists recorded and changed, each file whole or as it was."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from kinematics import load_machine
from planner import load_positions


@pytest.fixture
def path(call, tmp_path):
    file = tmp_path / "list.csv"
    for pose in ("10 mm, 0 mm, 25 mm", "-10 mm, 0 mm, 25 mm, 5 deg, 0 deg, 0 deg"):
        assert call("positions", file, "record", pose).exit_code == 0
    return file


def poses(call, path):
    done = call("positions", path, "--json")
    assert done.exit_code == 0, done.stderr
    return [
        [round(1e3 * value, 9) for value in pose[:3]] for pose in json.loads(done.stdout)["poses"]
    ]


def test_poses_are_recorded_put_in_and_taken_out(call, path):
    assert poses(call, path) == [[10, 0, 25], [-10, 0, 25]]
    done = call("positions", path, "insert", 2, "0 mm, 1 in, 0 mm")
    assert done.exit_code == 0
    assert "3 poses from home, Rx·Ry·Rz" in done.stdout
    assert poses(call, path) == [[10, 0, 25], [0, 25.4, 0], [-10, 0, 25]]
    assert call("positions", path, "remove", 1, 2).exit_code == 0
    assert poses(call, path) == [[-10, 0, 25]]
    assert [file.name for file in path.parent.iterdir()] == ["list.csv"]


def test_a_part_is_saved_and_run(call, path, tmp_path):
    call("positions", path, "record", "0 mm, 0 mm, 30 mm")
    part = tmp_path / "part.csv"
    assert call("positions", path, "save", part, "--first", 2, "--last", 2).exit_code == 0
    assert poses(call, part) == [[-10, 0, 25]]
    assert call("positions", path, "save", part).exit_code == 2
    assert call("positions", path, "save", part, "--force").exit_code == 0
    assert len(poses(call, part)) == 3
    done = call(
        "import", path, "--first", 2, "--last", 3, "--out", tmp_path / "program.toml", "--json"
    )
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["segments"] == 2
    assert json.loads(done.stdout)["entities"] == {"poses": 2}


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (("remove", 3), "no pose 3; it has poses 1 to 2"), (("insert", 5, "0 mm, 0 mm, 0 mm"), "no pose 5"),
        (("insert", 1, "0 mm, 0 mm"), "2 entries"), (("record", "0, 0 mm, 0 mm"), "without a unit"),
        (("record", "1e99 m, 0 mm, 0 mm"), "at most"), (("remove", 2, 1), "from 2 to 1"),
    ],
)  # fmt: skip
def test_what_is_wrong_leaves_the_list_as_it_was(call, path, edit, words):
    before = path.read_bytes()
    done = call("positions", path, *edit)
    assert done.exit_code == 2
    assert words in done.stderr
    assert path.read_bytes() == before
    assert [file.name for file in path.parent.iterdir()] == ["list.csv"]


def test_other_formats_are_shown_but_changed_as_csv(call, tmp_path):
    keys = ("____cex", "____cey", "____cez", "_____rx", "_____ry", "_____rz")
    other = tmp_path / "list.txt"
    other.write_text("".join(f"Polar1{key} 1.5\n" for key in keys))
    assert "1 pose from base, Ry·Rz·Rx" in call("positions", other).stdout
    refused = call("positions", other, "record", "0 mm, 0 mm, 0 mm")
    assert refused.exit_code == 2
    assert "lists are changed as CSV" in refused.stderr
    assert call("positions", other, "save", tmp_path / "list.csv").exit_code == 0
    assert "1 pose from base, Ry·Rz·Rx" in call("positions", tmp_path / "list.csv").stdout
    missing = call("positions", tmp_path / "none.csv")
    assert (missing.exit_code, missing.stdout) == (2, "")
    assert "No such file" in missing.stderr


def test_a_list_is_saved_as_the_three_armed_machine_has_it(call, path, tmp_path):
    """Read back in the base frame, within the format's decimals: as the machine's home and the list
    have it.
    """
    call("positions", path, "insert", 1, "1 mm, 2 mm, 3 mm, 10 deg, 20 deg, 30 deg")
    target = tmp_path / "saved.txt"
    assert call("positions", path, "save", target).exit_code == 0
    assert call("positions", path, "save", target).exit_code == 2
    lines = target.read_bytes().split(b"\r\n")
    assert lines[0].startswith(b"Polar1_____cex ")
    home, back, listed = load_machine("tripod").home, load_positions(target), load_positions(path)
    asked = home * RigidTransform.from_components(listed.poses[:, :3], listed.rotations)
    assert (back.frame, back.order) == ("base", "yzx")
    assert back.poses[:, :3] == pytest.approx(asked.translation, abs=1e-5)
    assert (back.rotations.inv() * asked.rotation).magnitude() == pytest.approx(0, abs=2e-5)


def test_a_list_of_the_three_armed_machine_asks_for_one(call, path, tmp_path):
    done = call("positions", path, "save", tmp_path / "saved.txt", "--machine", "hexapod")
    assert done.exit_code == 2
    assert "hexapod is not a tripod" in done.stderr
    assert not (tmp_path / "saved.txt").exists()
    assert (
        call("positions", path, "save", tmp_path / "saved.csv", "--machine", "tripod").exit_code
        == 2
    )


def test_arms_of_turned_poses_are_shown_and_saved_but_never_in_the_machine_s_own_format(
    call, path, tmp_path
):
    done = call("positions", path, "arms", "--json")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["turned"] == [False, True]
    assert found["off_if_held"][0] == 0 < found["off_if_held"][1]
    assert "only simulated" in call("positions", path, "arms").stdout
    assert (
        "1 rotations combined with a translation were dropped"
        in call("positions", path, "arms", "--steps").stdout
    )
    for suffix, code in ((".csv", 0), (".png", 0), (".txt", 2)):
        assert (
            call("positions", path, "arms", "--out", tmp_path / f"arms{suffix}").exit_code == code
        )
    assert not (tmp_path / "arms.txt").exists()
    assert "give --force" in call("positions", path, "arms", "--out", tmp_path / "arms.csv").stderr
    # and no plan is made of a turned one
    assert call("import", path, "--out", tmp_path / "turned.toml").exit_code == 0
    refused = call("check", tmp_path / "turned.toml", "--machine", "tripod")
    assert refused.exit_code == 1
    assert "rx" in refused.stderr


START_UP = [
    (0, 0, 0, 0, 0, 0),
    (100, 0, 0, 0, 0, 0),
    (50, 100, 0, 0, 0, 0),
    (0, 0, 0, 0, 0, 0),
    (0, 0, 50, 0, 0, 0),
    (0, 0, 50, 30, 0, 0),
]
"""What Form_Load of [KMITL 2005] records after its start: mm and degrees."""


def test_the_sources_start_up_list_is_bundled_and_within_reach(call, tmp_path):
    """The longest arm is the third at (50, 100, 0): from (−86.60, −150) to (32.68, 70) mm, 250 mm
    high.
    """
    shown = json.loads(call("positions", "tripod-start-up", "--json").stdout)
    listed = np.array(shown["poses"]) * [1e3, 1e3, 1e3, *np.rad2deg([1, 1, 1])]
    np.testing.assert_allclose(listed, START_UP, atol=1e-9)

    machine = load_machine("tripod")
    places = np.array(START_UP)[:5, :3] * 1e-3
    poses = machine.home * RigidTransform.from_translation(places)
    assert machine.check(poses).ok.all()
    lengths = machine.inverse(poses)
    assert 1e3 * lengths[2, 2] == pytest.approx(np.sqrt(119.2820**2 + 220**2 + 250**2), abs=1e-3)
    assert np.abs(lengths - machine.home_q).max() < machine.axes[0].travel[1]


def test_the_start_up_list_runs_and_is_not_changed(call, tmp_path):
    """Saved in the source's own format, which its reader takes; the pure rotation at its end is
    simulated only.
    """
    assert call("positions", "tripod-start-up", "save", tmp_path / "Textbar.txt").exit_code == 0
    text = (tmp_path / "Textbar.txt").read_text("ascii").splitlines()
    assert [float(line[14:21]) for line in text if line[:14] == "Polar3_____cey"] == [100]
    assert [float(line[14:21]) for line in text if line[:14] == "Polar6______rx"] == [30]

    refused = call("positions", "tripod-start-up", "remove", "1")
    assert refused.exit_code == 2
    assert 'is bundled with this package; "save" it as a CSV file first' in refused.stderr
    assert call("positions", "tripod-start-up", "arms").exit_code == 0
    assert (
        call("positions", "tripod-start-up", "save", tmp_path / "own.csv", "--last", "5").exit_code
        == 0
    )
    checked = call("check", tmp_path / "own.csv", "--machine", "tripod")
    assert checked.exit_code == 0, checked.stderr
