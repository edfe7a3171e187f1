"""Curves by their own length: as long as quadrature says, the same curve as before, as smooth at
the joins.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import MotionError
from planner import Arc, Blend, Line, Program, Spline, Turn
from planner.path.arc_length import even_speed, measure_length
from planner.path.chain import chain_pieces

START = RigidTransform.from_components([0.0, 0, 0.03], Rotation.identity())
SAID = {"speed": 0.005, "speed_constant": True}
BENT = Spline([[0.01, 0.005, 0.03], [0.02, 0, 0.031], [0.01, -0.01, 0.03]])


def drawn(machine, *segments):
    return chain_pieces(Program(segments, start=START), machine)


def slopes(piece, count=501):
    """|dp/ds| along a piece, by its own derivatives."""
    return np.linalg.norm(
        piece.derivatives(piece.start + piece.length * np.linspace(0, 1, count))[1][:, :3], axis=1
    )


def test_the_way_along_an_ellipse_and_back():
    """Its length by the complete elliptic integral; places by the inverse, at shares of the way."""
    from scipy.special import ellipe

    along = measure_length(lambda s: np.hypot(2 * np.sin(s), np.cos(s)), 0.0, 2 * np.pi)
    assert along.length == pytest.approx(8 * ellipe(0.75), rel=1e-14)
    shares = np.linspace(0, 1, 9)
    assert along.place(shares * along.length)[::2] == pytest.approx(
        shares[::2] * 2 * np.pi, abs=1e-13
    )  # by symmetry
    reached = quad(
        lambda s: np.hypot(2 * np.sin(s), np.cos(s)),
        0,
        along.place(shares * along.length)[1],
        epsabs=1e-13,
    )
    assert reached[0] == pytest.approx(along.length / 8, rel=1e-12)


@settings(max_examples=15)
@given(
    walk=st.lists(st.tuples(*[st.floats(-0.01, 0.01)] * 3).map(np.array), min_size=1, max_size=5),
    ahead=st.floats(0.004, 0.02),
)
def test_splines_at_constant_speed_have_their_length_as_parameter(hexapod, walk, ahead):
    """Steps that never turn back: the same curve, its length by quadrature, |dp/ds| = 1 to 1e-10
    between the points.
    """
    through = START.translation + np.cumsum(
        [step + np.array([ahead, 0, 0]) for step in walk], axis=0
    )
    try:
        plain = drawn(hexapod, Spline(through)).pieces
    except MotionError as refusal:
        assume("turns back" not in str(refusal) and "no direction" not in str(refusal))
        raise
    even = drawn(hexapod, Spline(through, **SAID)).pieces
    for piece in even:
        assert (
            np.abs(slopes(piece) - 1).max() < 2e-10
        )  # at the points of the way, and what lies between its 65 points
    whole = sum(
        quad(lambda s, piece=piece: slopes_at(piece, s), 0, piece.length, epsabs=1e-13)[0]
        for piece in plain
    )
    assert sum(piece.length for piece in even) == pytest.approx(whole, rel=1e-9)
    ends = np.concatenate([[0.0], np.cumsum([piece.length for piece in even])])
    assert even[-1].poses(np.array([even[-1].length]))[0, :3] - even[0].poses(np.zeros(1))[
        0, :3
    ] == pytest.approx(through[-1] - START.translation, abs=1e-14)
    # a place in the middle of the plain curve's last span, by its own length
    rest = quad(
        lambda s: slopes_at(plain[-1], s), plain[-1].length / 2, plain[-1].length, epsabs=1e-13
    )[0]
    there = ends[-1] - rest
    k = int(np.searchsorted(ends, there)) - 1
    same = plain[-1].poses(np.array([plain[-1].length / 2]))
    assert even[k].poses(np.array([there - ends[k]])) == pytest.approx(same, abs=1e-10)


def slopes_at(piece, s):
    return float(np.linalg.norm(piece.derivatives(np.array([piece.start + s]))[1][0, :3]))


@pytest.mark.parametrize(
    "segments",
    [
        (Line([0.01, 0, 0.03], **SAID, join=Blend(2e-4)), Line([0.01, 0.01, 0.03], **SAID)),
        (Line([0.01, 0, 0.03], join=Blend(2e-4)), Line([0.01, 0.01, 0.03], **SAID)),
        (Spline(BENT.through, join=Blend(2e-4)), Arc([0, -0.01, 0.03], [0, 0, 1], 2.0, **SAID)),
        (
            Spline(BENT.through, **SAID, join=Blend(2e-4)),
            Spline([[0.02, -0.02, 0.03], [0, -0.03, 0.03]]),
        ),
        (Line([0.01, 0, 0.03], **SAID, join=Blend(2e-4)), Turn(Rotation.from_rotvec([0.1, 0, 0]))),
    ],
)
def test_where_parameters_change_the_pose_stays_smooth(hexapod, segments):
    """Three derivatives of the pose meet at every join: to 1e-10 of the largest on the path, a
    tenth of a proof's.
    """
    chained = drawn(hexapod, *segments)
    assert not chained.stops[1:-1].any()
    sampled = [
        piece.derivatives(piece.start + piece.length * np.linspace(0, 1, 65))
        for piece in chained.pieces
    ]
    largest = [max(np.abs(each[k]).max() for each in sampled) for k in range(4)]
    for a, b in zip(chained.pieces[:-1], chained.pieces[1:], strict=True):
        left, right = (
            a.derivatives(np.array([a.start + a.length])),
            b.derivatives(np.array([b.start])),
        )
        for one, other, size in zip(left, right, largest, strict=True):
            assert one == pytest.approx(other, abs=1e-10 * size)
    assert any(piece.constant for piece in chained.pieces)
    for piece in chained.pieces:
        assert not piece.constant or np.abs(slopes(piece) - 1).max() < 2e-10


def test_only_what_needs_it_is_drawn_anew(hexapod):
    lines = (Line([0.01, 0, 0.03], **SAID), Arc([0, 0, 0.03], [0, 0, 1], 1.0, **SAID), BENT)
    first, second, *bent = (piece.shape.name for piece in drawn(hexapod, *lines).pieces)
    assert (first, second) == ("line", "arc")
    assert set(bent) == {"hermite"}
    plain = drawn(hexapod, Line([0.01, 0, 0.03], join=Blend(2e-4)), Line([0.01, 0.01, 0.03]))
    assert not any("even" in piece.shape.name for piece in plain.pieces)


def test_a_tool_that_stands_still_has_no_constant_speed(hexapod):
    turned = drawn(hexapod, Turn(Rotation.from_rotvec([0.1, 0, 0]))).pieces
    with pytest.raises(MotionError, match=r'segment 1: the tool nearly stops.*write join = "stop"'):
        even_speed(
            [replace(piece, constant=True) for piece in turned], np.array([1, 1]), np.zeros(2)
        )
