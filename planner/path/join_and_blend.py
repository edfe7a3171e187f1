"""Joins: what becomes of the places where segments meet: stops, smooth passages and blends that
never overlap.

In a blend one motion begins while the one before it ends, within a tolerance of the path that they
leave.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TypeVar

import casadi as ca
import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from planner.path.closeness import bound_distance
from planner.path.outcome import Blended
from planner.path.shape import LINE, Derived, Drawn, Fitted, Overshoot, Piece, Shape, measure_turns
from planner.program.modifiers import Blend, Fit, Stop

# Where the deviation may lie, as a share of the tolerance, and where the search aims: under 1 by
# more than what the sampling of the largest deviation can miss.
MIN_SHARE, TARGET_SHARE, MAX_SHARE = 0.97, 0.985, 0.998
# Points of a blend that are looked at, and as often as ZOOMS says so many between the neighbours of
# the farthest.
BLEND_POINTS, ZOOMS = 33, 2
# Newton steps to the nearest point of the unblended path, and the step (as a share of the reach)
# that is the last.
NEWTON_STEPS, LAST_NEWTON_STEP = 8, 1e-4
# Least speed along the path, as a share of what the neighbours have: a reversal comes to rest, and
# so close to one the blend's curvature has no use.
MIN_SPEED_SHARE = 0.01
# Guesses of how far a blend reaches; four are usual.
MAX_GUESSES = 60


Numbers = TypeVar("Numbers", ca.SX, Array)


@dataclass(frozen=True, slots=True)
class BlendFit:
    """A blend: how far it reaches (m), and by how much it leaves the unblended path, in position
    (m) and angle (rad).

    halves: its pieces, each a part of the segment whose place it takes and under that segment's
    caps
    """

    halves: tuple[Piece, Piece]
    reach: float
    deviation: float
    turned: float


@cache
def _shape(first: Shape, second: Shape) -> Shape:
    """p = A(a) + B(b) − J,  R = R_A(a) R_Jᵀ R_B(b): A's last length d and B's first, overlapping.

    J is the pose at the join, from which both are counted: over s from 0 to 2d, x = s/d − 1,

        a = −d (1 − x)⁴ (x² + 4x + 5)/32,   b = d (1 + x)⁴ (x² − 4x + 5)/32,   a + b = s − d.

    At the start a runs with s and b rests, at the end a rests and b runs, each with no second and
    third derivative: so the blend meets its neighbours with three continuous derivatives, whatever
    they are. Between lines it is the polynomial of degree 7 that does so.
    """
    return Shape(
        f"blend_{first.name}_{second.name}",
        15 + first.size + second.size,
        Derived(_motion, (first, second)),
    )


def _motion(first: Shape, second: Shape, s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    reach, from_a, from_b, position, rows, of_a, of_b = ca.vertsplit(
        parameters, np.cumsum([0, 1, 1, 1, 3, 9, first.size, second.size]).tolist()
    )
    a, b = overlap_lengths(s, reach)
    p_a, r_a = first.motion(from_a + a, of_a)
    p_b, r_b = second.motion(from_b + b, of_b)
    return p_a + p_b - position, r_a @ ca.reshape(
        rows, 3, 3
    ) @ r_b  # the rows, read as columns: R_Jᵀ


def overlap_lengths(s: Numbers, reach: Numbers | float) -> tuple[Numbers, Numbers]:
    """a(s) and b(s) of a blend, from the join."""
    x = s / reach - 1
    down, up = (1 - x) ** 2, (1 + x) ** 2
    return -reach / 32 * down * down * (x * x + 4 * x + 5), reach / 32 * up * up * (
        x * x - 4 * x + 5
    )


def fit_blend(a: Piece, b: Piece, most: float, tolerance: float, angle: float) -> BlendFit | None:
    """The blend of the end of `a` and the start of `b` that uses the tolerances, or takes `most`
    (m) of each.

    Deviation: a pose of the blend is compared with the nearest of the unblended path (the two
    pieces), where an angle counts as tolerance/angle times so many metres; the larger of the two,
    each as a share of its tolerance, has to lie between MIN_SHARE and MAX_SHARE. None where the
    motion all but reverses, in space (or in orientation, where one of the two only turns).
    """
    found: dict[float, tuple[float, float]] = {}

    def share(reach: float) -> float:
        found[reach] = _deviation(a, b, reach, tolerance / angle)
        return max(found[reach][0] / tolerance, found[reach][1] / angle)

    reach = _find_reach(share, most)
    halves = _halve_blend(a, b, reach, tolerance / angle)
    return None if halves is None else BlendFit(halves, reach, *found[reach])


def _find_reach(share: Callable[[float], float], most: float) -> float:
    """The length at which the share meets its aim, or `most`: secants of a share that grows like a
    power.
    """
    reach, used, power = most, share(most), 1.0
    low, high = 0.0, most
    for _ in range(MAX_GUESSES):
        if MIN_SHARE <= used <= MAX_SHARE or (used < MIN_SHARE and reach == most):
            break
        low, high = (reach, high) if used < TARGET_SHARE else (low, reach)
        guess = reach * (TARGET_SHARE / max(used, 1e-12)) ** (1 / power)
        if not low < guess < high:
            guess = (low + high) / 2
        before, reach = (reach, used), guess
        used = share(reach)
        slope = (
            np.log(used / before[1]) / np.log(reach / before[0]) if used > 0 < before[1] else 1.0
        )
        power = float(np.clip(slope, 0.5, 8.0))
    return reach


def _blend_piece(a: Piece, b: Piece, reach: float) -> Piece:
    join = b.poses(np.array([b.start]))[0]
    numbers = np.concatenate(
        [[reach, a.start + a.length, b.start], join, a.parameters, b.parameters]
    )
    return replace(
        a,
        shape=_shape(a.shape, b.shape),
        parameters=freeze_array(numbers),
        length=2 * reach,
        start=0.0,
    )


def _deviation(a: Piece, b: Piece, reach: float, weight: float) -> tuple[float, float]:
    """The largest deviations of the blend of some reach, in position (m) and angle (rad)."""
    piece = _blend_piece(a, b, reach)
    low, high = 0.0, 2 * reach
    most = np.zeros(2)
    for _ in range(1 + ZOOMS):
        s = np.linspace(low, high, BLEND_POINTS)
        x = piece.poses(s)
        on_a, on_b = overlap_lengths(s, reach)
        feet = [
            _pose_deviation(x, a, a.start + a.length + on_a, weight, LAST_NEWTON_STEP * reach),
            _pose_deviation(x, b, b.start + on_b, weight, LAST_NEWTON_STEP * reach),
        ]
        apart = [np.hypot(off[0], weight * off[1]) for off in feet]
        off = np.where(apart[0] < apart[1], feet[0], feet[1])
        most = np.maximum(most, off.max(1))
        top = int(np.argmax(np.maximum(off[0], weight * off[1])))
        low, high = s[max(top - 1, 0)], s[min(top + 1, BLEND_POINTS - 1)]
    return float(most[0]), float(most[1])


def _pose_deviation(x: Array, piece: Piece, s: Array, weight: float, last: float) -> Array:
    """(2, N) distance and angle from poses x (N, 12) to the nearest ones of a piece, by Newton from
    s (N,).
    """
    size = np.concatenate(
        [np.ones(3), np.full(9, weight / np.sqrt(2))]
    )  # |ΔR|/√2 is the angle, while it is small
    for _ in range(NEWTON_STEPS):
        y, y1, y2, _ = piece.derivatives(s)
        away, along = (x - y) * size, y1 * size
        square = (along**2).sum(1)
        bend = square - (away * y2 * size).sum(1)
        step = (away * along).sum(1) / np.where(bend > square / 4, bend, square)
        before, s = s, np.clip(s + step, piece.start, piece.start + piece.length)
        if np.abs(s - before).max() <= last:
            break
    away = x - piece.poses(s)
    chord = np.linalg.norm(away[:, 3:], axis=1) / np.sqrt(8)
    return np.stack([np.linalg.norm(away[:, :3], axis=1), 2 * np.arcsin(np.minimum(chord, 1.0))])


def _min_speed_share(piece: Piece, a: Piece, b: Piece, weight: float) -> float:
    """The least speed along a blend, as a share of its neighbours'; angles count where one of them
    only turns.
    """
    ends = [
        part.derivatives(np.array([s]))[1][0] for part, s in ((a, a.start + a.length), (b, b.start))
    ]
    still = any(np.linalg.norm(end[:3]) < MIN_SPEED_SHARE for end in ends)
    size = np.concatenate([np.ones(3), np.full(9, weight / np.sqrt(2) if still else 0.0)])
    slowest = np.linalg.norm(
        piece.derivatives(np.linspace(0.0, piece.length, BLEND_POINTS))[1] * size, axis=1
    ).min()
    return float(slowest / min(np.linalg.norm(end * size) for end in ends))


# A jump of a derivative of the pose that is rounding, as a share of its size: a tenth of what the
# certificate allows.
JUMP_ROUNDING = 1e-10
ALWAYS_REST, NEVER_REST = 1, 0
# Share of its tolerance that a blend whose distance is proved is to use at least, and what the
# search aims at; how many reaches are tried; and how far a blend of lines has begun the second
# where it leaves the first, by its reach.
PROOF_SHARE, PROOF_AIM, PROOF_TRIES, MIDDLE_SHARE = 0.9, 0.97, 6, 5 / 32
# The least that a blend may reach, as a share of the machine's characteristic length: its curvature
# goes with 1/reach, and below so much the rounding of coordinates leaves no proof of an
# acceleration within the certificate's tolerance. It is some 0.1 µm, far less than a pulse of the
# machines at hand.
MIN_REACH_SHARE = 1e-6
# Share by which two lengths may differ and be the same: rounding.
SAME_LENGTH = 1e-12


@dataclass(frozen=True, slots=True)
class PathStep:
    """A piece of a path and its end: the order of motion from which it rests there (0: never, 1:
    always), s of dwell.

    wait    s of rest before it; of a path's first piece alone
    blend   what became of the join at its end, where that asks for one
    fitted  the curve that ends with it
    avoidable  whether a stop at its end is not stated: the join is not smooth enough
    overshoot  how far the spline that ends with it leaves its polygon
    """

    piece: Piece
    stop: int = NEVER_REST
    dwell: float = 0.0
    wait: float = 0.0
    blend: Blended | None = None
    fitted: Fitted | None = None
    avoidable: bool = False
    overshoot: Overshoot | None = None


def list_avoidable(steps: Iterable[PathStep]) -> frozenset[int]:
    """List the numbers, from 1, of the steps that end in an avoidable stop."""
    return frozenset(number for number, step in enumerate(steps, 1) if step.avoidable)


def link(drawn: Iterable[Drawn], characteristic: float) -> Iterator[PathStep]:
    """The whole path, with blends where joins ask for them, as it is drawn.

    characteristic  m that count like a radian: the machine's characteristic length
    """
    before = wait = way = 0.0
    for own, after in _pairs(drawn):
        if not own.pieces:
            wait += own.dwell
            continue
        rest, made, blended = ALWAYS_REST, list[Piece](), None
        if not (after is None or isinstance(own.join, Stop)):
            rest = _rest_order(own.pieces[-1], after.pieces[0], own.dwell, characteristic)
            if isinstance(own.join, Fit) and own.join.stop and rest != NEVER_REST:
                rest = ALWAYS_REST
                angle = own.join.angle_at(characteristic)
                blended = Blended(
                    segment=own.pieces[-1].segment,
                    tolerance=own.join.tolerance,
                    angle=angle,
                    stop="as asked",
                    fitted=True,
                )
            elif isinstance(own.join, Blend | Fit) and rest != NEVER_REST:
                made, blended = _blend(own, after, own.join, characteristic)
                rest = NEVER_REST if made else ALWAYS_REST
        avoidable = (
            after is not None and rest != NEVER_REST and not _is_asked(own, after, characteristic)
        )
        reach = made[0].length if made else 0.0
        *inner, last = *_trim_pieces(own.pieces, before, reach), *made
        begin, way = way, way + sum(piece.length for piece in (*inner, last))
        fitted = own.fitted
        if fitted is not None:
            fitted = replace(fitted, s=min(begin + max(fitted.s - before, 0.0), way))
        overshoot = own.overshoot
        if overshoot is not None:
            overshoot = replace(overshoot, s=min(begin + max(overshoot.s - before, 0.0), way))
        if blended is not None:
            blended = replace(blended, s=way - (made[-1].length if made else 0.0))
        for piece in inner:
            yield PathStep(piece, wait=wait)
            wait = 0.0
        yield PathStep(last, rest, own.dwell, wait, blended, fitted, avoidable, overshoot)
        before, wait = reach, 0.0


def _pairs(drawn: Iterable[Drawn]) -> Iterator[tuple[Drawn, Drawn | None]]:
    """Each segment and the next."""
    held: Drawn | None = None
    for item in drawn:
        if held is not None:
            yield held, item
        held = item
    if held is not None:
        yield held, None


def _is_asked(before: Drawn, after: Drawn, characteristic: float) -> bool:
    """Return whether a dwell, a join, a trigger at a stop, or a reversal asks for the rest between
    two segments.
    """
    join = before.join
    if before.dwell > 0 or (isinstance(join, Fit) and join.stop):
        return True
    if isinstance(join, Stop) and (join.stated or 1.0 in before.marks or 0.0 in after.marks):
        return True
    return is_reversal(*_end_directions(before.pieces[-1], after.pieces[0], characteristic))


def _end_directions(a: Piece, b: Piece, characteristic: float) -> tuple[Array, Array]:
    """Directions (12,) in which one piece ends and the next begins; turning counts in metres."""
    size = np.concatenate([np.ones(3), np.full(9, characteristic / np.sqrt(2))])
    ends = ((a, a.start + a.length), (b, b.start))
    before, after = (_direction(part, s) * size for part, s in ends)
    return before, after


def _direction(piece: Piece, s: float) -> Array:
    """First derivative (12,) of the pose; of a line that does not turn without evaluating its
    shape.
    """
    if piece.shape is LINE and piece.parameters[-1] == 0:
        return np.concatenate([piece.parameters[3:6], np.zeros(9)])
    return np.asarray(piece.derivatives(np.array([s]))[1][0])


def is_reversal(before: Array, after: Array) -> bool:
    """Return whether the path runs back into itself between two directions: no blend could pass
    there.
    """
    sizes = float(np.linalg.norm(before)), float(np.linalg.norm(after))
    if min(sizes) == 0:  # the derivative vanishes there, so that no axis moves
        return True
    return float(np.linalg.norm(before / sizes[0] + after / sizes[1])) / 2 < MIN_SPEED_SHARE


def _rest_order(a: Piece, b: Piece, dwell: float, characteristic: float) -> int:
    """The order of motion from which it has to rest between two pieces: that of the first
    derivative that jumps, + 1.

    Orientation counts in metres, and curvatures against that of the machine's own size.
    """
    if dwell > 0:
        return ALWAYS_REST
    size = np.concatenate([np.ones(3), np.full(9, characteristic / np.sqrt(2))])
    ends = zip(
        a.derivatives(np.array([a.start + a.length])),
        b.derivatives(np.array([b.start])),
        strict=True,
    )
    for order, (left, right) in enumerate(ends):
        least = characteristic ** (1 - order)
        if np.abs((left - right) * size).max() > JUMP_ROUNDING * max(
            least, *np.abs(np.stack([left, right]) * size).max((1, 2))
        ):
            return order + 1
    return NEVER_REST


def _blend(
    before: Drawn, after: Drawn, asked: Blend | Fit, characteristic: float
) -> tuple[list[Piece], Blended]:
    """The pieces of the blend of two segments, none where there can be none, and what to say of
    it.
    """
    a, b = before.pieces[-1], after.pieces[0]
    angle = asked.angle_at(characteristic)
    blended = Blended(
        segment=a.segment, tolerance=asked.tolerance, angle=angle, fitted=isinstance(asked, Fit)
    )
    if before.dwell > 0:
        return [], replace(blended, stop="a dwell")
    most = {
        part.segment: _available_length(own.pieces, part) for own, part in ((before, a), (after, b))
    }
    if isinstance(asked, Blend):
        made = fit_blend(a, b, min(most.values()), asked.tolerance, angle)
    else:
        made = _fit_proved_blend(before, after, min(most.values()), asked.tolerance, angle)
    if made is None:
        return [], replace(blended, stop="it turns back")
    if made.reach < MIN_REACH_SHARE * characteristic:
        return [], replace(
            blended, stop=f"it would reach {made.reach * 1e6:.2g} um, too little beside rounding"
        )
    blended = replace(blended, deviation=made.deviation, turned=made.turned, reach=made.reach)
    if blended.tolerance_use < MIN_SHARE:
        blended = replace(
            blended,
            half_of=tuple(
                n for n, length in most.items() if length <= made.reach * (1 + SAME_LENGTH)
            ),
        )
    return list(made.halves), blended


def _fit_proved_blend(
    before: Drawn, after: Drawn, most: float, tolerance: float, angle: float
) -> BlendFit | None:
    """A blend at a corner between chains, of which it is proved how far it and what was programmed
    are apart.

    Of the tolerances, what the curves beside it leave: its own distance and theirs add up. Between
    straight motions that do not turn, a and b of them at the corner, the blend is apart from them
    by b(s) |B − A| before the join and −a(s) |B − A| behind it, where they have run as far as it
    has: at most (5/32) d |B − A|, and so much at the join.
    """
    a, b = before.pieces[-1], after.pieces[0]
    used = np.max([(0.0, 0.0), *_near_corner(before, after)], axis=0)
    left, spare = tolerance - float(used[0]), angle - float(used[1])
    ends = [
        part.derivatives(np.array([s]))[1][0, :3]
        for part, s in ((a, a.start + a.length), (b, b.start))
    ]
    jump = float(np.linalg.norm(ends[1] - ends[0]))
    if min(left, spare) <= 0:
        return None
    rate = MIDDLE_SHARE * jump
    # of all that is to be had nothing is left: a piece of no length between two blends
    reach = (
        most if rate * most <= left * (1 - 2 * SAME_LENGTH) else left / rate * (1 - 2 * SAME_LENGTH)
    )
    if all(part.shape is LINE and part.parameters[-1] == 0 for part in (a, b)) and not used.any():
        halves = _halve_blend(a, b, reach, tolerance / angle)
        return (
            None
            if halves is None
            else BlendFit(halves, reach, reach * rate * (1 + SAME_LENGTH), 0.0)
        )
    found, power, tried = None, 1.0 if rate > 0 else 2.0, list[tuple[float, float]]()
    for _ in range(PROOF_TRIES):
        halves = _halve_blend(a, b, reach, tolerance / angle)
        if halves is None:
            return None
        corner = [a.trim(a.length - reach, 0.0), b.trim(0.0, b.length - reach)]
        apart, turned = bound_distance(halves, corner, tolerance, angle).worst
        use = max(apart / left, turned / spare)
        if use <= 1 and (found is None or reach > found.reach):
            found = BlendFit(halves, reach, apart + float(used[0]), turned + float(used[1]))
        if PROOF_SHARE <= use <= 1 or (use <= 1 and reach == most):
            break
        tried.append((np.log(reach), np.log(use)))
        if len(tried) > 1 and tried[-1][0] != tried[-2][0]:
            slope = (tried[-1][1] - tried[-2][1]) / (tried[-1][0] - tried[-2][0])
            power = float(np.clip(slope, 1.0, 4.0))
        reach = min(most, reach * float(np.clip(PROOF_AIM / use, 1e-4, 1e4)) ** (1 / power))
    return found


def _halve_blend(a: Piece, b: Piece, reach: float, weight: float) -> tuple[Piece, Piece] | None:
    """The two halves of a blend of some reach, each a part of its own segment; None where it all
    but turns back.
    """
    whole = _blend_piece(a, b, reach)
    if _min_speed_share(whole, a, b, weight) < MIN_SPEED_SHARE:
        return None
    first, second = whole.cut(2)
    second = replace(
        b, shape=whole.shape, parameters=whole.parameters, length=reach, start=second.start
    )
    first, second = measure_turns([first, second])
    return first, second


def _near_corner(before: Drawn, after: Drawn) -> list[tuple[float, float]]:
    """How far (m, rad) curves that meet at a corner may be from what was programmed there."""
    tails = [before.fitted.tail] if before.fitted is not None else []
    return [*tails, after.fitted.head] if after.fitted is not None else tails


def _available_length(own: Sequence[Piece], end: Piece) -> float:
    """What a blend may take of a segment at one of its ends: half of it, and not more than its
    piece there (m).
    """
    half = sum(piece.length for piece in own) / 2
    return min(half, end.length / 2 if len(own) == 1 else end.length)


def _trim_pieces(own: Sequence[Piece], before: float, after: float) -> list[Piece]:
    """A segment's pieces without the lengths that blends take of the first and the last."""
    if len(own) == 1:
        kept = [own[0].trim(before, after)]
    else:
        kept = [own[0].trim(before, 0.0), *own[1:-1], own[-1].trim(0.0, after)]
    least = SAME_LENGTH * sum(
        piece.length for piece in own
    )  # of two halves taken, rounding may be left
    return [piece for piece in kept if piece.length > least]
