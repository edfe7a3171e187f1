"""G-code of joint axes: refused where no machine is told, and by forward kinematics the way that
was exported.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics import FileError, MotionError, load_machine
from planner import Blend, Dwell, Line, Program, Turn, import_program, plan
from planner.path.actuation import actuate

TURNED = Rotation.from_euler("XYZ", [3, -4, 2], degrees=True)
WAYS = {
    "hexapod": [
        Line([0.01, 0, 0.02], Rotation.from_euler("XYZ", [3, -4, 2], degrees=True)),
        Dwell(0.25),
        Line([0, 0.01, 0.03]),
    ],
    "tripod": [Line([0.005, 0, -0.01]), Dwell(0.25), Line([0, 0.01, 0])],
    "linkage": [Line([0.02, 0, 0]), Dwell(0.25), Line([0.02, -0.03, 0])],
    "traverser": [
        Line([0.02, 0.01, 0.03]),
        Dwell(0.25),
        Turn(Rotation.from_euler("z", 30, degrees=True)),
    ],
}


@pytest.fixture(scope="module", params=WAYS)
def exported(request, tmp_path_factory):
    """Name of the machine, its plan, and the file."""
    name = request.param
    machine = load_machine(name)
    machine = machine.driven_by(
        [replace(axis, backlash=0.0, lead_error=None, compensate=()) for axis in machine.axes]
    )
    path = tmp_path_factory.mktemp("g93") / "way.ngc"
    found = plan(Program(WAYS[name]), machine, order=2)
    found.export("g93", path)
    return name, found, path


def test_it_is_not_taken_for_places_of_the_tool(exported):
    """It was read as x, y, z of leg millimetres, and angles of leg millimetres too."""
    _, found, path = exported
    first = found.machine.axes[0].name
    with pytest.raises(
        FileError, match=rf"way.ngc:2: its words are joint axes \(\w = {first}.*give its machine"
    ) as no:
        import_program(path)
    assert len(no.value.faults) == 1


def test_with_its_machine_it_is_the_way_that_was_planned(exported):
    """Every place within what half a pulse in each axis and straight lines between points make; the
    rest with it.
    """
    name, found, path = exported
    back = import_program(path, machine=name)
    assert back.program.machine == name
    assert [s.duration for s in back.program.segments if isinstance(s, Dwell)] == pytest.approx(
        [0.25], abs=3e-6
    )
    way = actuate(back.program, load_machine(name))
    s = np.linspace(0, found.path.breaks[-1], 400)
    piece = np.clip(
        np.searchsorted(found.path.breaks, s, side="right") - 1, 0, len(found.path.breaks) - 2
    )
    planned = found.path.derivatives(s, piece)[0]
    knots = np.concatenate(
        [way.derivatives(way.breaks[:-1], np.arange(len(way.breaks) - 1))[0], planned[-1:]]
    )
    # the nearest point of the polyline through the points that were read, in pulses of the axis
    # that is off most
    start, step = knots[:-1], np.diff(knots, axis=0)
    share = ((planned[:, None] - start) * step).sum(2) / np.maximum((step**2).sum(1), 1e-30)
    near = start + np.clip(share, 0, 1)[..., None] * step
    off = np.abs(planned[:, None] - near) / [axis.pulse for axis in found.machine.axes]
    assert off.max(2).min(1).max() < 0.75
    assert back.warnings[0].startswith("its words are joint axes: positions are those of")


def test_options_and_joins(exported):
    name, _, path = exported
    blended = import_program(path, machine=name, blend=1e-5).program
    assert any(
        isinstance(segment.join, Blend) for segment in blended.segments if isinstance(segment, Line)
    )
    with pytest.raises(MotionError, match="origin does not apply to a file of joint axes"):
        import_program(path, machine=name, origin="0 mm, 0 mm, 1 mm")


def test_natural_coordinates_are_the_same_places(tmp_path):
    found = plan(Program([Line([0.002, 0, -0.002])]), load_machine("tripod"), order=2)
    ends = []
    for origin in ("home", "natural"):
        found.export("g93", tmp_path / f"{origin}.ngc", origin=origin)
        ends.append(import_program(tmp_path / f"{origin}.ngc", machine="tripod").program)
    assert ends[0].start.as_matrix() == pytest.approx(ends[1].start.as_matrix(), abs=1e-9)
    assert ends[0].segments[-1].to == pytest.approx(ends[1].segments[-1].to, abs=1e-9)


def test_what_does_not_fit_is_refused(tmp_path, hexapod):
    path = tmp_path / "way.ngc"
    plan(Program([Line([0, 0, 0.001])]), hexapod, order=2).export("g93", path)
    text = path.read_text()

    def refused(changed, told, **options):
        path.write_text(changed)
        with pytest.raises(MotionError, match=told):
            import_program(path, **({"machine": "hexapod"} | options))

    refused(text, "it is for the axes X = leg1, .* machine tripod has arm1 in mm", machine="tripod")
    refused(
        text.replace("(positions from home, in the sense of the axes)\n", ""),
        "does not state the origin",
    )
    refused(text.replace("G94", "G2 X1 Y1 I1"), "not a line of a file of joint axes")
    refused(text.replace("G94", "G1 X1 F60"), "not a line of a file of joint axes")
    refused(
        text.replace("G94", "G1 X900 Y0 Z0 A0 B0 C0 F60"),
        "no pose that is proved to be connected to home",
    )
    refused("G21 G90\nG1 X1 F60\n", "machine is for files of joint axes, which way.ngc is not")
    path.write_text(
        "G21 G90\nG1 X1 Y2 Z3 A1 F60\n"
    )  # a file of the tool's places stays what it was
    assert np.asarray(import_program(path).program.segments[0].to).tolist() == [0.001, 0.002, 0.003]
