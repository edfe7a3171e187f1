"""Words of G-code that are left out: their arguments go with them, and the path stays as it is
without their line.
"""

import pytest

from kinematics import FileError, MotionError
from planner import import_program
from planner.sources.gcode import Gcode
from planner.sources.rs274.words import PATH_M

HEAD, TAIL = "G21 G90\nG1 X10 Y10 F1500\n", "\nX50 Y10\n"
COMMANDS = [
    "M16 my printer", "M17 X Y", "M18 Z E", "M20 S1", "M23 /part.gco", "M26 S49315", "M42 P3 S255",
    "M48 P4 X100 Y20 V4",
    "M73 P10 R5", "M75 a name", "M84 X Y S60", "M92 X80 Y80 Z400 E93", "M104 S200 T1", "M106 P0 S255", "M109 R180",
    "M117 Hello World", "M117 50% done (left", "M117 G28 done", "M117 G1 X3", "M118 E1 A1 X5 hi", "M140 S60",
    "M150 R255 U0 B0 I1", "M163 S0 P0.5", "M200 D1.75", "M201 X500 Y500 Z100 E5000", "M203 X250 Y250",
    "M204 P800 R1500",
    "M205 X20 Y20 J0.02", "M207 S1 F40 Z0.2", "M211 S1", "M220 S80", "M221 T0 S95", "M226 P2 S1", "M260 A99 B77",
    "M280 P0 S90", "M301 H1 P22.2 I1.08 D114", "M302 P1 S170", "M350 X16 Y16", "M355 S1 P110", "M400", "M413 S1",
    "M420 S1 Z10", "M486 T12", "M500", "M550 P\"the mill\"", "M569 P0 S1", "M572 D0 S0.05", "M587 S\"net\" P\"x y\"",
    "M593 F42.4", "M600 X3 Y3 Z20", "M862.3 P \"MK3S\"", "M900 K0.05", "M906 X800 Y800", "M913 X100",
    "M0 Click to go on",
    "M0 S5", "M1 P500", "M3 S1000 $1", "M4 $0 S50", "M5 $1", "M19 R90 P1", "M48", "M50 P0", "M51 P1 $0", "M61 Q3",
    "M66 P1 L3 Q5", "M68 E1 Q2", "M101 P1 Q2", "M199 P[1 + 2] Q#99", "M64 P#<none>", "M10", "M11", "M88",
    "M3 P1 S500", "M5 P1", "M6 T1 H2", "M8 P0 S20", "M9 S0", "M60 P1", "M1 L2 R3", "M4 S1 T2",
]  # fmt: skip


def moves(done):
    return [((part.to * 1e3).round(9).tolist(), part.speed) for part in done.program.segments]


@pytest.mark.parametrize("form", ["{}", "N20 {}", "{} ; or not", "  {}  ", "{}(comment)"])
def test_a_word_takes_its_arguments_along(read, form):
    without = moves(read(HEAD + TAIL))
    for command in COMMANDS:
        word = command.split()[0]
        ignore = "" if word == "M73" else word
        text = HEAD + form.format(command) + TAIL
        assert moves(read(text, ignore=ignore)) == without, command
        assert moves(read(text, ignore="M")) == without, command


@pytest.mark.parametrize(
    "text", ["G2 X20 I5 M0 P2", "X20 I5 M8 P2", "G3 X20 I5 M205 P2", "G4 M9 P2", "G2 X20 M5 R5"]
)
def test_numbers_that_two_words_may_own_are_refused(read, text):
    """Turns of an arc, the s of a dwell, a radius: without them it is another program."""
    with pytest.raises(
        FileError, match="may belong to the word that is left out or to its block's G word"
    ):
        read(f"{HEAD}G2 X12 I1\n{text}{TAIL}", ignore="M")


@pytest.mark.parametrize(
    ("text", "ignore", "x"),
    [
        ("X20 M205 X3", "M205", 20), ("M8 X20", "M8", 20), ("M3 S5 X20", "M3", 20), ("M6 T1 X20", "M6", 20),
        ("G1 X20 M150 P2 Q1", "M150", 20), ("M205 X3 G1 X20", None, None), ("M5 M9 X20", "M5 M9", 20),
        ("M104 S200 M106 S5", "M104 M106", 10), ("M205 X3 M8", "M205 M8", 10), ("G43 H1 X20", "G43", 20),
        ("G1 X20 M7", "M7", 20), ("M60 X20", "M60", 20), ("X20 M0", "M0", 20), ("G97 S500 X20", "G97", 20),
    ],
)  # fmt: skip
def test_words_of_a_motion_stay_with_it(read, text, ignore, x):
    if ignore is None:
        with pytest.raises(
            FileError, match="X3 may belong to the word that is left out or to its block's G word"
        ):
            read(HEAD + text, ignore="M205")
        return
    assert moves(read(HEAD + text, ignore=ignore))[-1][0][0] == x


@pytest.mark.parametrize("word", ["G10", "G11", "G28", "G41", "G42", "G43.1", "G52", "G53", "G76", "G81", "G92",
                                  "G92.1",
                                  "G98", "G99", *(f"M{value:g}" for value in sorted(PATH_M))])  # fmt: skip
def test_words_that_change_the_path_are_not_left_out(tmp_path, word):
    with pytest.raises(MotionError, match="cannot be ignored"):
        Gcode(ignore=word)
    path = tmp_path / "part.nc"
    path.write_text(f"{HEAD}{word}{TAIL}")
    assert "ignore" not in describe_refusal(path)


def describe_refusal(path):
    """What is said of a file; empty: it is read."""
    try:
        import_program(path)
    except FileError as refused:
        return str(refused)
    return ""


def test_every_m_word_that_is_refused_can_be_left_out_or_changes_the_path(read, tmp_path):
    """The message offers to leave a word out exactly where the option takes it."""
    offered = []
    path = tmp_path / "word.nc"
    for number in range(200):
        path.write_text(f"{HEAD}M{number}{TAIL}")
        message = describe_refusal(path)
        if f'ignore="M{number}"' in message:
            offered.append(number)
            done = read(f"{HEAD}M{number} X1{TAIL}", ignore=f"M{number}")
            assert moves(done) == moves(read(HEAD + TAIL))
        elif message:
            assert float(number) in PATH_M
    assert not PATH_M & set(map(float, offered))
    assert {10, 48, 105, 199} <= set(offered)


def test_an_origin_of_a_printer_is_left_out_only_before_the_first_move(read):
    done = read("G21\nM206 X5 Y5\nG1 X10 F600\n", ignore="M206")
    assert moves(done)[0][0] == [10, 0, 0]
    with pytest.raises(FileError, match="M206 moves the origin after the tool has moved"):
        read(f"{HEAD}M206 X5{TAIL}", ignore="M206")


def test_a_spindle_is_selected_where_a_word_takes_one(read):
    done = read(f"{HEAD}M3 $1 S100\nX20{TAIL}")
    assert done.program.segments[0].trigger.name == "M3 S100"
    for text in ("$1", "M8 $1", "X20 $0", "$H", "$100=5"):
        with pytest.raises(FileError):
            read(f"{HEAD}{text}{TAIL}")
