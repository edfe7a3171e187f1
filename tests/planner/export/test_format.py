"""What every format claims of its file, whatever the program: it has moves, and the deviation is of
all the way.
"""

from dataclasses import replace

import numpy as np
import pytest

from kinematics import MotionError, load_machine
from planner import Arc, Blend, Dwell, Line, Program, Spline, plan
from planner.export.format import FORMATS, Exported, ExportSource, export, find_format, is_moving

MACHINES = ("traverser", "tripod", "linkage", "arm", "hexapod")
BACK = [Line([0.001, 0, 0]), Line([0.001, 0.0005, 0]), Line([0, 0.0005, 0]), Line([0, 0, 0])]
PROGRAMS = {
    "stops": [*BACK[:2], Dwell(0.1)],
    "back to the start": BACK,
    "blends": [*(replace(line, join=Blend(5e-5)) for line in BACK[:2]), BACK[2]],
    "a blended loop": [*(replace(line, join=Blend(5e-5)) for line in BACK[:3]), BACK[3]],
    "arc": [Line([0.001, 0.001, 0]), Arc([0.001, 0.0005, 0], [0, 0, 1], np.pi)],
    "spline": [Spline([[0.0004, 0.0002, 0], [0.0008, 0.0001, 0], [0.001, 0.0005, 0]])],
    "nanometres": [Line([4e-9, 0, 0])],
}
SOME = ("stops", "blends", "nanometres")
REFUSED = {
    "adlink": "has no card",
    "adlink-csv": "has no card",
    "byte": "a byte holds 4 at most",
    "kmitl-arms": "a tripod's, three arms",
    "kmitl-positions": "a tripod's, three arms",
    "sahbaz": "has no card",
    "sasidhar": "is not a capital letter",
}
"""Of formats that are not for every machine: what they say."""
WHOLE = (
    "the pulses, edge by edge",
    "the pulses, tick for tick",
    "the pulses, joined by straight lines",
    "the counts after every step",
    "the motion, ",
    "the path, ",
)


@pytest.fixture(scope="module", params=MACHINES)
def sources(request):
    """A plan of every program (the traverser's formats lose most), of some on others; the hexapod
    starts higher.
    """
    machine, found = load_machine(request.param), {}
    lift = np.array([0, 0, 0.002 if machine.name == "hexapod" else 0.0])
    for name, segments in PROGRAMS.items():
        if machine.name != "traverser" and name not in SOME:
            continue
        begin = [Line(lift)] if lift.any() and name != "nanometres" else []
        moved = [raised(segment, lift if begin else 0 * lift) for segment in segments]
        if lift.any() and not begin:  # aside it would leave its legs' travel
            moved = [Line([0, 0, 4e-9])]
        made = plan(Program((*begin, *moved)), machine, order=2)
        found[name] = ExportSource(name, made.machine, made.trajectory, made.pulses)
    return found


def raised(segment, lift):
    for field in ("to", "centre", "through"):
        if hasattr(segment, field):
            return replace(segment, **{field: getattr(segment, field) + lift})
    return segment


@pytest.mark.parametrize("name", FORMATS)
def test_no_file_is_without_moves_and_no_deviation_is_claimed_that_is_not_of_all_the_way(
    sources, name, tmp_path
):
    for program, source in sources.items():
        try:
            done = export(find_format(name)(), name, source, tmp_path / "file")
        except MotionError as no:
            told = str(no)
            assert told.startswith((name, "kmitl", "adlink", "format")), told
            expected = program == "nanometres" and (
                "the file would hold no move" in told or "no move to write" in told
            )
            expected |= name in REFUSED and REFUSED[name] in told
            expected |= (
                name == "sasidhar"
                and program == "a blended loop"
                and "stops only where it starts" in told
            )
            expected |= (
                name == "sahbaz"
                and program == "blends"
                and "which a trapezoidal move cannot do" in told
            )
            assert expected, (program, told)
            continue
        assert done.moves is not None, f"{name} does not tell how many moves its file holds"
        assert done.moves > 0
        assert (tmp_path / "file").stat().st_size > 0
        assert done.against.startswith(WHOLE)
        assert np.isfinite(done.error)
        assert done.error >= 0


class Wrong:
    """A format whose file holds what it says."""

    def __init__(self, done):
        self.done = done

    def write(self, source, path):
        path.write_bytes(b"")
        return self.done


@pytest.mark.parametrize(
    ("done", "told"),
    [
        (
            Exported(0.0, "the motion", moves=0),
            "would hold no move, and the plan's motion cannot be expressed in it",
        ),
        (
            Exported(np.inf, "the pulses", moves=3),
            "decodes to another motion than the plan's, against the pulses",
        ),
        (Exported(np.nan, "the pulses", moves=3), "decodes to another motion"),
    ],
)
def test_a_file_that_is_not_the_plans_is_never_kept(tmp_path, done, told):
    made = plan(Program((Line([0.001, 0, 0]),)), load_machine("traverser"))
    source = ExportSource("p", made.machine, made.trajectory, made.pulses)
    assert is_moving(source)
    with pytest.raises(MotionError, match=told):
        export(Wrong(done), "wrong", source, tmp_path / "x")


def test_an_export_that_is_refused_leaves_no_file(tmp_path):
    loop = [*(replace(line, join=Blend(5e-5)) for line in BACK[:3]), BACK[3]]
    made = plan(Program(loop), load_machine("traverser"))
    with pytest.raises(MotionError, match="stops only where it starts"):
        made.export("sasidhar", tmp_path / "lines.txt")
    assert not list(tmp_path.iterdir())


READ = {"pulses": "utf-8", "zaber": "utf-8", "adlink-csv": "utf-8"}
BINARY = ("npz", "binary", "byte")


@pytest.mark.parametrize("name", [name for name in FORMATS if name not in BINARY])
def test_text_is_in_the_encoding_that_its_reader_takes_and_says_what_we_say(
    sources, name, tmp_path
):
    """The C export's header had `within \\xbd more` and `pulses\\u002fs`: our own words are ASCII
    where the file is.
    """
    try:
        done = export(find_format(name)(), name, sources["stops"], tmp_path / "file")
    except MotionError:
        return  # as the test above has it
    text = (tmp_path / "file").read_bytes().decode(READ.get(name, "ascii"))
    assert text.isascii()
    assert not set(text) & {"\x00", "\t", "\ufeff"}
    assert "\\" not in text
    assert name != "adlink" or all(note in text for note in done.notes)
