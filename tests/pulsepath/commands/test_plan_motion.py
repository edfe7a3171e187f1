"""The option --motion: a program from pose to pose, in a plan's directory that later commands take
up.
"""

import json

import pytest

from planner.export.formats.sahbaz import read_moves

PROGRAM = """\
schema = 1
machine = "hexapod"
length = "mm"
angle = "deg"

[[segment]]
line = { to = [0.5, 0, 1], rotate = [0, 0, 1] }

[[segment]]
arc = { centre = [0.5, 0.2, 1], normal = [0, 0, 1], angle = 360 }

[[segment]]
line = { to = [0, 0, 0], rotate = [0, 0, 0] }
"""


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return tmp_path_factory.mktemp("moves")


def test_a_program_is_planned_exported_and_taken_up_so(call, out):
    file = out / "there.toml"
    file.write_text(PROGRAM)
    done = call(
        "plan",
        file,
        "--motion",
        "synchronised",
        "--order",
        "2",
        "--no-figures",
        "--out",
        out / "plan",
        "--json",
    )
    assert done.exit_code == 0, done.stderr
    assert "segment 2 ends where it starts: skipped" in done.stderr
    record = json.loads(done.stdout)
    assert record["certificate"]["holds"]
    assert [move["where"]["segment"] for move in record["synchronised_moves"]] == [1, 2]
    assert all(0 < move["off_the_line_m"] < 1e-4 for move in record["synchronised_moves"])
    assert all(axis["net_count"] == 0 for axis in record["pulses"]["axes"].values())
    assert (out / "plan" / "program.toml").read_text().count("synchronised = {") == 2
    assert "2, straight in the axes: up to 0.00" in (out / "plan" / "report.html").read_text()
    for name in ("sahbaz", "adlink-csv"):
        written = call("export", out / "plan", "--format", name, "--out", out / name, "--json")
        assert written.exit_code == 0, written.stderr
        assert json.loads(written.stdout)["error_pulses"] < 1
    assert len(read_moves(out / "sahbaz")) == 12


def test_check_and_dump_know_it_and_what_cannot_move_is_refused(call, tmp_path):
    file = tmp_path / "there.toml"
    file.write_text(PROGRAM)
    done = call("-v", "check", file, "--motion", "synchronised")
    assert done.exit_code == 0
    assert "straight in the axes, not in space" in done.stdout
    assert (
        "synchronised = { to"
        in call("check", file, "--motion", "synchronised", "--dump-config", "-").stdout
    )
    assert call("check", file, "--motion", "sideways").exit_code == 2
    done = call(
        "plan",
        "bare-circle",
        "--motion",
        "synchronised",
        "--machine",
        "hexapod",
        "--out",
        tmp_path / "plan",
    )
    assert done.exit_code == 2
    assert "synchronised moves would not move at all" in done.stderr
    assert not (tmp_path / "plan").exists()
