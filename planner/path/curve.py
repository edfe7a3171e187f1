"""Curves by equations: the way that formulas of t lead, by its length, proved to be smooth and
never to stand still.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from kinematics.foundation.arrays import MAX_DISTANCE, Array, freeze_array
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.errors import MotionError
from kinematics.foundation.formula import formula
from kinematics.foundation.taylor_model import Series
from kinematics.machine.pose import column, from_numbers, join_pose, split_pose_symbols, to_numbers
from planner.path.arc_length import draw_by_length, is_uneven, measure_length
from planner.path.shape import Derived, Piece, Shape, axis_rotation, turning_angles
from planner.program.model import MIN_MOVE, Curve

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose

# Cells of t at first, how often each may be halved until it is proved, and how many there may be.
FIRST_CELLS, MAX_HALVINGS, MAX_CELLS = 64, 24, 1 << 14
# Derivatives that are proved to be finite: those that a certificate of jerk needs, and one more.
PROVED_DERIVATIVES = 4
# Points of a part that show its turning, at first and at most, and by what share twice as many may
# differ.
FIRST_POINTS, MAX_POINTS, TURNING_AGREEMENT = 65, 4097, 1e-3
# Share of the largest |dp/dt| below which a curve stands still, for its user; places looked at, and
# zooms to the least.
STANDSTILL_SHARE, SEARCH_POINTS, ZOOMS = 1e-4, 4097, 3


@dataclass(frozen=True, slots=True)
class CurveEquations:
    """What the formulas of some segments have in common: the shape that they draw, and the pose by
    t for its proof.

    shape   parameters: t at the start, dt/ds, and the frames before and after the formulas' own
            pose (12 + 9)
    pose    t -> twelve numbers, as the formulas have them
    """

    shape: Shape
    pose: Expression


@dataclass(frozen=True, slots=True)
class Formulas:
    """The pose by t: texts of position and of rotation in turn about x, y, z, and their units in m
    and rad.
    """

    position: tuple[str, str, str]
    rotate: tuple[str, str, str] | None
    constants: tuple[tuple[str, float], ...]
    length: float
    angle: float

    def draw(self, t: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return position and rotation as expressions of t."""
        known = dict(self.constants)
        place = ca.vertcat(*(self.length * formula(text, known, t) for text in self.position))
        turned = ca.SX.eye(3)
        for axis, text in enumerate(self.rotate or ()):
            turned = turned @ axis_rotation(axis, self.angle * formula(text, known, t))
        return place, turned


def curve_equations(curve: Curve) -> CurveEquations:
    """Return the equations of a segment; equal formulas give the same object, whose maps are built
    once.
    """
    formulas = Formulas(curve.position, curve.rotate, curve.constants, curve.length, curve.angle)
    return _make_equations(formulas)


@lru_cache(maxsize=64)
def _make_equations(formulas: Formulas) -> CurveEquations:
    t = ca.SX.sym("t")
    pose = Expression("curve_pose", t, column(*formulas.draw(t)))
    return CurveEquations(Shape("curve", 23, Derived(_motion, (formulas,))), pose)


def _motion(formulas: Formulas, s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the pose at s: parameters as `CurveEquations` has them."""
    start, rate, before, after = ca.vertsplit(parameters, [0, 1, 2, 14, 23])
    place, turned = formulas.draw(start + rate * s)
    offset, frame = split_pose_symbols(before)
    return offset + frame @ place, frame @ turned @ ca.reshape(after, 3, 3).T


def ends(curve: Curve) -> "tuple[Pose, Pose]":
    """Where the formulas have the tool at both ends; where they do not turn it, the orientation is
    the identity's.
    """
    x = curve_equations(curve).pose(np.array([[curve.begin], [curve.end]]))
    for place, t in zip(x, (curve.begin, curve.end), strict=True):
        if not np.isfinite(place).all():
            raise MotionError(
                f"its equations have no finite value at t = {t:.6g}; choose a range of t where they have one"
            )
    return from_numbers(x[0]), from_numbers(x[1])


def curve(start: "Pose", segment: Curve, frame: "Pose", number: int) -> list[Piece]:
    """The pieces from start (base frame) along a segment's equations, which hold in `frame`.

    Their parameter is the way itself, to 1e-10 (planner.path.arc_length). Where the equations begin
    within MIN_MOVE of the start they are moved to begin there. Raises MotionError, which names t,
    where they are not finite, not smooth, or stand still.
    """
    made = curve_equations(segment)
    prove_smooth(made.pose, segment.begin, segment.end)
    first, _ = ends(segment)
    turn = (
        first.rotation.inv() * frame.rotation.inv() * start.rotation
    )  # what follows the formulas' own rotation
    place = start.translation - frame.rotation.apply(first.translation)
    before = to_numbers(join_pose(place, frame.rotation))[0]
    after = turn.as_matrix().ravel()

    def piece(begin: float, end: float) -> Piece:
        span = abs(end - begin)
        whole = Piece(
            made.shape,
            freeze_array(np.concatenate([[begin, np.sign(end - begin)], before, after])),
            span,
            number,
        )
        length = measure_length(
            lambda s: np.linalg.norm(whole.derivatives(s)[1][:, :3], axis=1), 0.0, span
        ).length
        own = freeze_array(np.concatenate([[begin, (end - begin) / length], before, after]))
        return Piece(made.shape, own, length, number)

    try:
        pieces = _by_length(piece, segment.begin, segment.end, MAX_HALVINGS)
    except _UnevenCurve as uneven:
        raise MotionError(
            _explain_failure(made.pose, segment.begin, segment.end, uneven.t)
        ) from None
    return [replace(each, turn=_measure_turning(each)) for each in pieces]


class _UnevenCurve(Exception):
    """Around t the curve cannot be parted finely enough to have its length as its parameter."""

    def __init__(self, t: float) -> None:
        super().__init__()
        self.t = t


def _explain_failure(pose: Expression, begin: float, end: float, t: float) -> str:
    """Whether a curve that failed around t is too slow, and where, or changes too fast for its
    interval.
    """
    low, high = sorted((begin, end))
    own, fastest = np.linspace(low, high, SEARCH_POINTS), 0.0
    for _ in range(ZOOMS):  # towards the slowest place of all
        speeds = _curve_speeds(pose, own)
        slowest, fastest = int(np.argmin(speeds)), max(fastest, float(speeds.max()))
        slow, least = float(own[slowest]), float(speeds[slowest])
        own = np.linspace(
            own[max(slowest - 1, 0)], own[min(slowest + 1, SEARCH_POINTS - 1)], SEARCH_POINTS
        )
    if least < STANDSTILL_SHARE * fastest:
        at = round(slow, 6 - int(np.floor(np.log10(high - low)))) + 0.0
        return (
            f"it nearly stops around t = {at:.6g}, with {least / fastest:.1g} of its largest |dp/dt|; take "
            "another t, along which it moves more evenly"
        )
    return (
        f"it changes too often between t = {low:.6g} and {high:.6g} to be followed to {MIN_MOVE:g} m, first around "
        f"t = {t:.6g}; shorten the interval, or use a smoother curve"
    )


def _by_length(
    piece: Callable[[float, float], Piece], begin: float, end: float, halvings: int
) -> list[Piece]:
    """The curve for t from begin to end, in as many parts as it takes to have its length as its
    parameter.
    """
    whole = piece(begin, end)
    if not is_uneven(whole):
        return [whole]
    if whole.length <= MIN_MOVE:
        raise _UnevenCurve(begin)
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # where a polynomial is far from what it should follow
        drawn = draw_by_length(whole)
        if not is_uneven(drawn):
            return [drawn]
    if halvings == 0:
        raise _UnevenCurve(begin)
    middle = (begin + end) / 2
    first, last = (
        _by_length(piece, *span, halvings - 1) for span in ((begin, middle), (middle, end))
    )
    return [*first, *last]


def _measure_turning(piece: Piece) -> float:
    points = FIRST_POINTS
    angle = float(turning_angles([piece], points)[0])
    while points < MAX_POINTS:
        before = angle
        points = 2 * points - 1
        angle = float(turning_angles([piece], points)[0])
        if abs(angle - before) <= TURNING_AGREEMENT * angle:
            break
    return angle


def _curve_speeds(pose: Expression, t: Array) -> Array:
    """|dp/dt| (N,)."""
    rates = _rates(pose)(t[:, None])
    return np.asarray(np.linalg.norm(rates, axis=1))


@lru_cache(maxsize=64)
def _rates(pose: Expression) -> Expression:
    t = ca.SX.sym("t")
    return Expression("curve_rate", t, ca.jacobian(pose.function(t)[:3], t))


def _refuse_far(pose: Expression, t: Array) -> None:
    """A curve that leads, at some t (N,), farther away than any machine reaches."""
    away = np.abs(pose(t[:, None])[:, :3]).max(1)
    if (away > MAX_DISTANCE).any() and np.isfinite(away).all():
        k = int(np.argmax(away))
        raise MotionError(
            f"it leads {away[k]:g} m away at t = {t[k]:.6g}; at most {MAX_DISTANCE:g} m can be taken"
        )


def prove_smooth(pose: Expression, begin: float, end: float) -> None:
    """That the equations have finite derivatives everywhere, and |dp/dt| > 0: by enclosures over
    cells of t.

    Derivatives are enclosed up to the order PROVED_DERIVATIVES.
    Raises MotionError naming a t around which that is not so, or cannot be told from it.
    """
    edges = np.linspace(min(begin, end), max(begin, end), FIRST_CELLS + 1)
    _refuse_far(pose, edges)
    low, high = edges[:-1], edges[1:]
    for _ in range(MAX_HALVINGS):
        rough, still = _find_doubtful_cells(pose, low, high)
        doubtful = rough | still
        if not doubtful.any():
            return
        if doubtful.sum() > MAX_CELLS:
            speeds = _curve_speeds(pose, (low + high) / 2)
            if not (np.isfinite(speeds).all() and speeds.all()):
                break
            raise MotionError(
                f"its equations change so fast around t = {_place(low, high, doubtful):.6g} that nothing can be proved "
                "about them; split the curve, or use simpler equations"
            )
        low, high = low[doubtful], high[doubtful]
        middle = (low + high) / 2
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    rough, still = _find_doubtful_cells(pose, low, high)
    if rough.any():
        raise MotionError(
            f"its equations are not smooth, or not finite, at t = {_place(low, high, rough):.6g}: a root or log of 0, "
            "a quotient by 0, or a kink of abs, min or max; choose another range of t, or split the curve there"
        )
    if still.any():
        raise MotionError(
            f"it stands still at t = {_place(low, high, still):.6g}: x', y' and z' are 0 there; take a t "
            "along which it moves, as 10*t for 10*t**2; where it turns back, two curves that meet there"
        )


def _place(low: Array, high: Array, chosen: np.ndarray) -> float:
    """A number in or beside the first of some chosen cells, with no more digits than tell it from
    others.
    """
    k = int(np.argmax(chosen))
    return round(float(low[k] + high[k]) / 2, int(np.floor(-np.log10(4 * (high[k] - low[k])))))


def _find_doubtful_cells(
    pose: Expression, low: Array, high: Array
) -> tuple[np.ndarray, np.ndarray]:
    """(N,) bool each: cells on which some derivative may be unbounded, and others on which the
    speed may be 0.
    """
    middle, half = (low + high) / 2, (high - low) / 2 * (1 + 1e-12)
    ones = np.ones_like(middle)
    t = Series(np.stack([middle, ones]), np.stack([half, 0 * ones]), PROVED_DERIVATIVES)
    found = Series.stack([*pose.enclose([t]), Series.zeros(PROVED_DERIVATIVES, low.shape)])
    with np.errstate(invalid="ignore", over="ignore"):
        rough = ~(np.isfinite(found.mid) & np.isfinite(found.rad)).all((0, 2))
        speed = np.linalg.norm(found.mid[1, :, :3], axis=1) - np.linalg.norm(
            found.rad[1, :, :3], axis=1
        )
    moves = rough | (speed > 0)
    return np.asarray(rough), np.asarray(~moves)
