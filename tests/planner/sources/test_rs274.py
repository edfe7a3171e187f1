"""Expressions, O-words and offsets of G-code: against Python's own arithmetic, and programs
unrolled by hand.
"""

import math
from io import StringIO

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import FileError
from planner import Arc, Fit, Line, import_program
from planner.sources.rs274.expressions import Cursor, Parameters
from planner.sources.rs274.words import split_lines

SIGNS = {
    "+": "+",
    "-": "-",
    "*": "*",
    "EQ": "==",
    "NE": "!=",
    "GT": ">",
    "GE": ">=",
    "LT": "<",
    "LE": "<=",
}


@pytest.fixture
def read(tmp_path):
    def of(text, **options):
        path = tmp_path / "part.ngc"
        path.write_text(text)
        return import_program(path, **{"feed": 0.01, "join": "stop"} | options)

    return of


def places(done):
    return np.array([part.to for part in done.program.segments if isinstance(part, Line)]) * 1e3


def evaluate(text, **values):
    parameters = Parameters()
    for name, value in values.items():
        parameters.set(name, value)
    cursor = Cursor(text, 0, parameters)
    found = cursor.value()
    assert cursor.next == ""
    return found


numbers = st.integers(-9, 9).map(
    lambda k: (f"#<_a>*[{k}]" if k % 3 == 0 else str(k), f"(2*({k}))" if k % 3 == 0 else str(k))
)
terms = st.recursive(
    numbers.map(lambda pair: (f"[{pair[0]}]", f"({pair[1]})")),
    lambda inner: st.tuples(inner, st.sampled_from(list(SIGNS)), inner).map(
        lambda t: (
            f"[{t[0][0]} {t[1].lower()} {t[2][0]}]",
            f"(1.0*({t[0][1]} {SIGNS[t[1]]} {t[2][1]}))",
        )
    ),
    max_leaves=8,
)


@settings(max_examples=100)
@given(pair=terms)
def test_arithmetic_is_that_of_another_language(pair):
    mine, python = pair
    assert evaluate(mine, _a=2.0) == pytest.approx(eval(python))  # noqa: S307  # of text made above


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("[2 + 3 * 4 - 5]", 9), ("[2 ** 3 ** 2]", 64), ("[2 * 3 ** 2]", 18), ("[7 mod 4 * 2]", 6), ("[-7 MOD 4]", 1),
        ("[1 LT 2 AND 3 LT 2]", 0), ("[1 OR 0 XOR 1]", 0), ("[8 - 3 - 2]", 3), ("[8/4/2]", 1), ("-[3]", -3),
        ("SIN[30]", 0.5), ("cos[60]", 0.5), ("TAN[45]", 1), ("ASIN[1]", 90), ("ACOS[0]", 90), ("ATAN[1]/[-1]", 135),
        ("SQRT[16]", 4), ("EXP[1]", math.e), ("LN[EXP[2]]", 2), ("ABS[-3]", 3), ("FIX[-2.5]", -3), ("FUP[-2.5]", -2),
        ("ROUND[-2.5]", -3), ("ROUND[2.4]", 2), ("EXISTS[#<_no>]", 0), ("EXISTS[#<_a>]", 1), ("#<_A>", 5),
        ("- #<_a>", -5),
    ],
)  # fmt: skip
def test_values_that_the_language_states(text, value):
    assert evaluate(text, _a=5.0) == pytest.approx(value, abs=1e-12)


def test_parameters_hold_behind_their_line(read):
    """#1 is set at the end of its line; a parameter may name another."""
    done = read(
        "G21 G0\n#1 = 5 #7 = 1\n#1 = 6 X#1\nX#1 Y[#1 * 2]\nX##7 Z-#<Depth>\n".replace(
            "-#<Depth>", "1"
        )
    )
    np.testing.assert_allclose(places(done), [[5, 0, 0], [6, 12, 0], [6, 12, 1]])


def test_lines_run_in_the_order_that_loops_make(read):
    text = """G21 G91 G1
O100 sub (#1: way, #2: times)
  o101 repeat [#2]
    X#1
    o102 if [#1 LT 2]
      o101 continue
    o102 elseif [#1 EQ 3]
      Y1
    o102 else
      Y2
    o102 endif
    O103 IF [#1 gt 3]
      o100 return [7]
    O103 endif
  o101 endrepeat
O100 endsub [1]
o100 call [1] [2]
o100 call [2] [1]
o100 call [3] [2]
o100 call [4] [5]
Z#<_value>
#3 = 0
o<while> while [1]
  #3 = [#3 + 1]
  o105 if [#3 EQ 3]
    o<while> break
  o105 endif
  Z1
o<while> endwhile
o104 do
  X-1
  #3 = [#3 - 1]
o104 while [#3 GT 1]
"""
    steps = np.diff(places(read(text)), axis=0, prepend=np.zeros((1, 3)))
    x, y, z = np.eye(3)
    wanted = [x, x, 2 * x, 2 * y, 3 * x, y, 3 * x, y, 4 * x, 2 * y, 7 * z, z, z, -x, -x]
    np.testing.assert_allclose(steps, wanted, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("o1 sub\nX1", "1: column 1: o1 sub has no end: write o1 endsub"),
        ("o1 if [1]\no2 while [1]\no1 endif", "3: column 1: o1 endif has no o1 if that is open here"),
        ("o1 else", "1: column 1: o1 else has no o1 if"), ("o1 break", "o1 break is not inside a loop o1"),
        ("G0 X1\no7 call", "2: column 1: o7 is not a sub of this file: add it there"),
        ("o1 return", "o1 return is not inside a sub"), ("o1 repeat\no1 endrepeat", "needs a value"),
        ("o1 sub\no1 endsub\no1 sub\no1 endsub", "3: column 1: o1 sub is defined twice"),
        ("o1 while [#9]\no1 endwhile", "1: column 11: #9 has no value here"),
        ("o1 sub\no1 call\no1 endsub\no1 call", "2: column 1: calls within calls: more than 20 deep"),
        ("o1 while [1]\no1 endwhile", "runs more than"),
        ("o1 jump", 'column 1: "o1 jump": an O-word is a label and one of sub'),
        ("o1 while [1] X1\no1 endwhile", "1: column 14: while takes nothing but values in brackets"),
        ("G0 X[[[[[[[" + "[" * 60, "brackets within brackets"), ("G0 X[2 PLUS 3]", "PLUS is no operator"),
        ("#1 2", 'column 5: "=" is missing here'), ("G0 X#<a", "has no end"), ("X[1e3]", "e is no operator"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_them_is_told(text, told, read, monkeypatch):
    monkeypatch.setattr("planner.sources.rs274.flow.MAX_LINES", 1000)
    with pytest.raises(FileError) as refused:
        read(text)
    assert told in str(refused.value)


def test_a_fault_of_a_line_that_runs_again_is_told_once(read):
    with pytest.raises(FileError) as refused:
        read("o1 repeat [50]\nG5\nG0 X1\no1 endrepeat")
    assert [fault.line for fault in refused.value.faults] == [2]


def test_systems_that_the_file_states_lie_from_home(read):
    """G10 L2 moves and turns, L20 names where the tool is, G92 shifts all: each against the point
    by hand.
    """
    text = """G21 G90 G0
G10 L2 P2 X10 Y5 R90
G55 X2 Y1
G54 X2 Y1 (where the option origin has its zero)
G10 L20 P3 X0 Y0 Z0
G56 X1
G92 X0 Z4
X1 Z5
G92.2
X1 Z1
G92.3
X1
G92.1
X0 Z0
G53 Y7
G10 L2 P0 X1 Y1 Z1
X0 Y0 Z0
"""
    wanted = [
        [9, 7, 0], [3, 1, 0], [4, 1, 0], [5, 1, 1], [4, 1, 1], [5, 1, 1], [3, 1, 0], [3, 7, 0], [1, 1, 1],
    ]  # fmt: skip
    done = read(text, origin="1 mm, 0 mm, 3 mm")
    np.testing.assert_allclose(places(done), np.array(wanted) - [1, 0, 3], atol=1e-9)


def test_arcs_turn_with_their_system(read):
    """Of every plane: ends and centres are those of the plain file, turned and moved."""
    moves = "G2 X2 Y0 I1 P2\nG18 G3 X4 Z1 R2\nG19 G3 Y2 J1\n"
    plain, turned = (
        read(f"G21 G90{system}\nG0 X0 Y0 Z0\n{moves}", feed=0.01)
        for system in ("", " G10 L2 P1 X3 R30")
    )
    angle = math.radians(30)
    turn = np.array(
        [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]]
    )
    arcs = [
        [part for part in done.program.segments if isinstance(part, Arc)]
        for done in (plain, turned)
    ]
    for one, other in zip(*arcs, strict=True):
        np.testing.assert_allclose(turn @ one.centre + [3e-3, 0, 0], other.centre, atol=1e-12)
        np.testing.assert_allclose(turn @ one.normal, other.normal, atol=1e-12)
        assert (one.angle, one.rise) == (other.angle, other.rise)
    assert arcs[0][0].angle == pytest.approx(-3 * math.pi)


def test_home_is_come_to_by_the_way_that_is_stated(read):
    done = read("G21 G90 G1 X5 Y6 Z2\nG91 G28 Z1\nG90 G28\nX1", origin="0 mm, 0 mm, 10 mm")
    np.testing.assert_allclose(
        places(done), [[5, 6, 2], [5, 6, 3], [5, 6, -10], [0, 0, -10], [1, 0, -10]]
    )
    assert done.entities == {"G0": 3, "G1": 2}


def test_what_says_nothing_of_the_path_is_read(read):
    """The preamble of most posts; a tolerance that is not stated is the option's; a dwell is before
    its motion.
    """
    done = read(
        "G17 G21 G40 G49 G54 G8 G80 G90 G94\nG64\nG0 X1\nG64 P0 Q0.1\nX2\nG64P.02Q.01\nX3\nG1 X4 G4 P1\n",
        fit=1e-4,
    )
    joins = [part.join for part in done.program.segments if isinstance(part, Line)]
    assert [join.tolerance for join in joins[:2]] == [1e-4, 1e-4]
    assert isinstance(joins[0], Fit)
    assert [type(part).__name__ for part in done.program.segments] == [
        "Line",
        "Line",
        "Line",
        "Dwell",
        "Line",
    ]


@pytest.mark.parametrize(("deleted", "wanted"), [("skip", [1, 3]), ("run", [1, 2, 3])])
def test_blocks_are_deleted_where_that_is_asked_for(read, deleted, wanted):
    done = read("G21 G0 X1\n  /X2\nX3", block_delete=deleted)
    assert places(done)[:, 0].tolist() == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("G54 G0 X1\nG55 X2", "it moved under G54 and moves under G55, and does not say where they lie"),
        ("G10 L1 P1 Z1", "column 5: G10 states systems only"), ("G10 L2 X1", "G10 needs P, the system"),
        ("G92 I3", "column 5: I beside G92 is not supported"), ("G91 G53 G0 X1", "G53 needs G0 or G1, and G90"),
        ("F60 G2 X2 I1 P0", "G2 takes P, its number of turns"), ("F60 G2 X2 I1 P1.5", "column 14: G2 takes P"),
        ("G64 P-1", "G64 takes P and Q that are not negative"), ("G0 X1 L2", "L2 is not supported"),
        ("G80 X1", "no G0, G1, G2 or G3 is active"),
    ],
)  # fmt: skip
def test_what_cannot_be_known_is_refused(text, told, read):
    with pytest.raises(FileError) as refused:
        read(text)
    assert told in str(refused.value)


def test_radii_may_differ_by_what_is_allowed(read):
    text = "G21 G0 X10\nF60 G2 X-10.02 I-10\n"
    with pytest.raises(FileError, match="arc_tolerance"):
        read(text)
    assert "arcs end up to 20 um from their end points" in str(
        read(text, arc_tolerance=3e-5).warnings
    )


@given(text=st.text(st.sampled_from("G1 X\n\x0b\u2028"), max_size=40))
def test_lines_of_a_text_end_at_line_feeds_only(text: str) -> None:
    assert list(split_lines(text)) == list(StringIO(text))
