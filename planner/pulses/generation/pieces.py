"""The motion of every axis as quintic pieces, true to the trajectory to rounding.

How fast it gets at most: bounds on the derivatives of its pieces, over continuous time. And the
pieces of one axis cut so that each runs one way only.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array, freeze_fields
from kinematics.foundation.errors import MotionError
from kinematics.foundation.polynomials import (
    bernstein_matrix,
    derivative,
    shift_polynomials,
    solve_heights,
)
from kinematics.foundation.units import format_distinct
from kinematics.machine.axis import Axis
from planner.place import Infeasible, Place
from planner.pulses.motion import AxesMotion, PositionMotion

PROBES = np.array(
    [0.3, 0.7]
)  # off the middle: there an error that is odd about the middle would hide
X_ROUNDING = 16 * np.finfo(float).eps
FIT_TOLERANCE = 1e-6  # of a pulse: how well pieces meet a motion whose own noise hides more
MIN_WAY_SHARE = 1e-9  # share of the path's length over which a slope dq/ds is more than rounding
# times the error of the pieces where it was looked at: that of a sextic is 1.7 times larger
# elsewhere
UNSEEN_FACTOR = 4
BLOCK_INTERVALS = 1 << 14
MAX_HALVINGS, MAX_PIECES = (
    24,
    1 << 18,
)  # a motion that asks for more, of an interval or of all together, is not smooth


@dataclass(frozen=True, slots=True)
class Pieces:
    """q(t) = Σ c_i uⁱ, i = 0..5, with u = (t - start) / length in [0, 1].

    start, length  (P,) s
    coefficients   (n, 6, P) m or rad
    noise          (n,) m or rad: what rounding alone does to q, from the size of q and of q̇·t, and
                   where s is rounded
    error          (n,) m or rad by which the pieces err at most where they were held against the
                   motion
    """

    start: Array
    length: Array
    coefficients: Array
    noise: Array
    error: Array

    def __post_init__(self) -> None:
        freeze_fields(self, "start", "length", "coefficients", "noise", "error")


def fit(motion: AxesMotion, tolerance: Array) -> Pieces:
    """Quintics through q, q̇, q̈ at both ends of every knot interval, halved until they meet the
    motion to rounding.

    The accelerations are one-sided, since q̈ may jump at a knot. A piece is also taken when halving
    no longer helps (the motion's own noise is reached) and it errs by at most `tolerance` (n,), or
    by what rounding of s makes of q on a long way, which is as large where the motion passes
    slowly: that is the noise then. Raises MotionError for a motion that is not smooth between its
    knots, or has no duration.
    """
    lo, hi = motion.knots[:-1], motion.knots[1:]
    lo, hi = lo[hi > lo], hi[hi > lo]
    if not len(lo):
        raise MotionError(
            f"the motion ends at {motion.duration} s, where it starts; give it time to move"
        )
    before = np.full((len(lo), len(tolerance)), np.inf)
    fitted: list[tuple[Array, Array, list[Array]]] = []
    reach, speed, drift, worst, rough = np.zeros((5, len(tolerance)))
    for depth in range(MAX_HALVINGS):
        coefficients, error, size, rate, along = _quintics(motion, lo, hi)
        reach, speed, drift = (
            np.maximum(reach, size),
            np.maximum(speed, rate),
            np.maximum(drift, along),
        )
        noise = X_ROUNDING * (reach + speed * motion.duration)
        most = np.maximum(tolerance, X_ROUNDING * (reach + speed * motion.duration + drift))
        good = ((error <= noise) | ((error <= most) & (error > before / 4))).all(axis=1)
        worst = np.maximum(worst, error[good].max(axis=0, initial=0.0))
        rough = np.where(worst > np.maximum(tolerance, noise), worst, 0.0)
        if good.all():
            fitted.append((lo, hi, coefficients))
            break
        for k, own in enumerate(
            coefficients
        ):  # one after the other goes: they are most of what a plan holds
            coefficients[k] = own[:, good]
        fitted.append((lo[good], hi[good], coefficients))
        lo, hi, before = lo[~good], hi[~good], np.repeat(error[~good], 2, axis=0)
        if depth == MAX_HALVINGS - 1 or len(lo) > MAX_PIECES:
            raise _roughness_error(lo, error[~good], most)
        middle = (lo + hi) / 2
        lo, hi = np.column_stack((lo, middle)).ravel(), np.column_stack((middle, hi)).ravel()
    start, end = (np.concatenate([piece[k] for piece in fitted]) for k in (0, 1))
    order = np.argsort(start)
    every = np.empty((len(tolerance), 6, len(start)))
    for k in range(len(tolerance)):
        parts = [piece[2][k] for piece in fitted]
        for piece in fitted:
            piece[2][k] = _NOTHING
        every[k] = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)[:, order]
        del parts
    start, end = start[order], end[order]
    every.flags.writeable = False
    return Pieces(start, end - start, every, np.maximum(noise, rough), worst)


def _roughness_error(lo: Array, error: Array, tolerance: Array) -> MotionError:
    piece, axis = np.unravel_index((error / tolerance).argmax(), error.shape)
    strays, most = format_distinct(error[piece, axis], tolerance[axis], digits=3)
    return MotionError(
        f"axis {axis + 1}: the motion near t = {lo[piece]:.9g} s strays {strays} from any polynomial, "
        f"more than {most}; put a knot where it is not smooth, and give its true q̇ and q̈"
    )


_NOTHING = np.empty((6, 0))


def _quintics(
    motion: AxesMotion, lo: Array, hi: Array
) -> tuple[list[Array], Array, Array, Array, Array]:
    """Of each axis coefficients (6, P), largest error at the probes (P, n), and the largest |q|,
    |q̇| and s·dq/ds (n,).

    In blocks: a state holds far more than what is kept.
    """
    blocks = [slice(first, first + BLOCK_INTERVALS) for first in range(0, len(lo), BLOCK_INTERVALS)]
    axes = motion.at(lo[:1]).q.shape[1]
    coefficients, error = [np.empty((6, len(lo))) for _ in range(axes)], np.empty((len(lo), axes))
    reach, speed, drift = np.zeros((3, axes))
    for block in blocks:
        found, error[block], size, rate, along = _block(motion, lo[block], hi[block])
        for every, own in zip(coefficients, found, strict=True):
            every[:, block] = own
        reach, speed, drift = (
            np.maximum(reach, size),
            np.maximum(speed, rate),
            np.maximum(drift, along),
        )
    return coefficients, error, reach, speed, drift


def _block(motion: AxesMotion, lo: Array, hi: Array) -> tuple[Array, Array, Array, Array, Array]:
    h = (hi - lo)[:, None]
    # The last instant of an interval still has its own acceleration; the knot itself belongs to the
    # next interval.
    ends = motion.at(np.concatenate((lo, np.nextafter(hi, lo))))
    q, qd, qdd = ends.q, ends.qd, ends.qdd
    (q0, q1), (v0, v1), (a0, a1) = (np.split(values, 2) for values in (q, qd, qdd))
    v0, v1, a0, a1 = v0 * h, v1 * h, a0 * h**2, a1 * h**2
    r, s, w = q1 - q0 - v0 - a0 / 2, v1 - v0 - a0, a1 - a0
    c = np.stack(
        (q0, v0, a0 / 2, 10 * r - 4 * s + w / 2, -15 * r + 7 * s - w, 6 * r - 3 * s + w / 2)
    )
    t = (lo[:, None] + PROBES * (hi - lo)[:, None]).ravel()
    true = motion.positions_at(t) if isinstance(motion, PositionMotion) else motion.at(t).q
    true = true.reshape(len(lo), len(PROBES), -1)
    ours = np.einsum("ipn,ui->pun", c, PROBES[:, None] ** np.arange(6))
    return (
        c.transpose(2, 0, 1),
        abs(true - ours).max(axis=1),
        abs(q).max(axis=0, initial=0),
        abs(qd).max(axis=0, initial=0),
        _drift(ends.s, q0, q1),
    )


def _drift(s: Array, q0: Array, q1: Array) -> Array:
    """(n,) the largest |s|·|Δq/Δs| of intervals, s (2 P,) at their starts and ends: rounding of s
    shows so in q.
    """
    far, way = abs(s).max(initial=0.0), abs(np.diff(s.reshape(2, -1), axis=0)[0])
    seen = way > MIN_WAY_SHARE * far
    return np.asarray(far * (abs(q1 - q0)[seen] / way[seen, None]).max(axis=0, initial=0.0))


MAX_CUTS = 48  # halvings of [0, 1]: by then a stretch is narrower than rounding


@dataclass(frozen=True, slots=True)
class Stretches:
    """Monotone stretches x(v) = Σ c_i vⁱ, v = (t - start) / length in [0, 1], in the order of time.

    start, length  (S,) in the unit of time of the pieces
    coefficients   (6, S)
    """

    start: Array
    length: Array
    coefficients: Array

    @property
    def ends(self) -> Array:
        """(S+1,) x at the start of each stretch, and at the end of the last."""
        return np.append(self.coefficients[0], self.coefficients[:, -1:].sum(axis=0))


def cut_monotone(start: Array, length: Array, coefficients: Array, slack: float) -> Stretches:
    """The pieces (P,), (P,), (6, P) cut at their turning points; inside a stretch x runs back by at
    most `slack`.
    """
    blocks = [
        slice(first, first + BLOCK_INTERVALS) for first in range(0, len(start), BLOCK_INTERVALS)
    ]
    parts = [_cut_block(start[own], length[own], coefficients[:, own], slack) for own in blocks]
    return Stretches(
        np.concatenate([part.start for part in parts]),
        np.concatenate([part.length for part in parts]),
        np.concatenate([part.coefficients for part in parts], axis=1),
    )


def _cut_block(start: Array, length: Array, coefficients: Array, slack: float) -> Stretches:
    """Undecided pieces are halved until the Bernstein coefficients of x′ have one sign, or change
    it once: there the root is found.
    """
    piece, lo, width = np.arange(len(start)), np.zeros(len(start)), np.ones(len(start))
    done: list[tuple[NDArray[np.intp], Array, Array]] = []
    for depth in range(MAX_CUTS + 1):
        slope = derivative(shift_polynomials(coefficients[:, piece], lo, width))
        control = bernstein_matrix(4) @ slope
        decided = (
            (control >= -slack).all(axis=0) | (control <= slack).all(axis=0) | (depth == MAX_CUTS)
        )
        turning = ~decided & (np.count_nonzero(np.diff(control > 0, axis=0), axis=0) == 1)
        done.append((piece[decided], lo[decided], width[decided]))
        if turning.any():
            cut = _root(slope[:, turning]) * width[turning]
            done.append((piece[turning], lo[turning], cut))
            done.append((piece[turning], lo[turning] + cut, width[turning] - cut))
        halve = ~decided & ~turning
        if not halve.any():
            break
        piece, lo, width = (
            np.repeat(piece[halve], 2),
            np.repeat(lo[halve], 2),
            np.repeat(width[halve] / 2, 2),
        )
        lo[1::2] += width[1::2]
    piece, lo, width = (np.concatenate([part[i] for part in done]) for i in range(3))
    order = np.lexsort((lo, piece))
    piece, lo, width = piece[order], lo[order], width[order]
    return Stretches(
        start[piece] + lo * length[piece],
        width * length[piece],
        shift_polynomials(coefficients[:, piece], lo, width),
    )


def _root(slope: Array) -> Array:
    """The one root in (0, 1) of each quartic (5, S) that changes sign there."""
    rising = slope * np.where(slope[0] > 0, -1.0, 1.0)
    climb = np.vstack((rising[1:], np.zeros(rising.shape[1])))
    every = np.arange(rising.shape[1])
    root, _ = solve_heights(climb, every, -rising[0], np.full(len(every), 4 * np.finfo(float).eps))
    return root


RATE_PARTS = 8  # of each piece: the bound's excess falls with their square


def bound_rate(pieces: Pieces, axis: int, times: int) -> tuple[float, float]:
    """Never less than |dᵏq/dtᵏ| of an axis anywhere, k = times (1 or 2), and where (s) it is about
    reached.

    A polynomial lies within its Bernstein coefficients; each piece is cut in eight, where they are
    close to it.
    """
    count = len(pieces.start)
    lo = np.tile(np.arange(RATE_PARTS) / RATE_PARTS, count)
    part = shift_polynomials(
        np.repeat(pieces.coefficients[axis], RATE_PARTS, axis=1),
        lo,
        np.full(len(lo), 1 / RATE_PARTS),
    )
    for _ in range(times):
        part = part[1:] * np.arange(1, len(part))[:, None]
    degree = len(part) - 1
    length = np.repeat(pieces.length, RATE_PARTS)
    control = abs(bernstein_matrix(degree) @ part) / (length / RATE_PARTS) ** times
    nth, worst = np.unravel_index(control.argmax(), control.shape)
    place = np.repeat(pieces.start, RATE_PARTS)[worst] + length[worst] * (
        lo[worst] + nth / degree / RATE_PARTS
    )
    return float(control[nth, worst]), float(place)


def find_rate_jumps(pieces: Pieces, axis: int) -> tuple[Array, Array]:
    """Where (s) pieces meet, and by how much q̇ jumps there: by rounding, or where the error of a
    screw bends.
    """
    c = pieces.coefficients[axis]
    ends = (np.arange(6) @ c / pieces.length)[:-1]
    return pieces.start[1:], abs((c[1] / pieces.length)[1:] - ends)


def rate_error(
    motion: AxesMotion, axis: Axis, t: float, rate: float, limit: float, remedy: str
) -> Infeasible:
    """The refusal of a pulse rate (1/s) at t (s)."""
    place = Place(float(motion.at(np.array([t])).s[0]), t=t, axis=axis.name)
    return Infeasible("pulse rate", axis.name, place, rate, limit, "1/s", remedy)
