"""The motion of every axis as quintic pieces, true to the trajectory to rounding."""

from dataclasses import dataclass

import numpy as np

from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.units import apart
from planner.pulses.motion import Motion

PROBES = np.array([0.3, 0.7])  # off the middle: there an error that is odd about the middle would hide
ROUNDING = 16 * np.finfo(float).eps
FINE = 1e-6  # of a pulse: how well pieces meet a motion whose own noise hides more
SEEN = 1e-9  # share of the path's length over which a slope dq/ds is more than rounding
UNSEEN = 4  # times the error of the pieces where it was looked at: that of a sextic is 1.7 times larger elsewhere
BLOCK = 1 << 14
HALVINGS, MOST = 24, 1 << 18  # a motion that asks for more, of an interval or of all together, is not smooth


@dataclass(frozen=True, slots=True)
class Pieces:
    """q(t) = Σ c_i uⁱ, i = 0..5, with u = (t - start) / length in [0, 1].

    start, length  (P,) s
    coefficients   (n, 6, P) m or rad
    noise          (n,) m or rad: what rounding alone does to q, from the size of q and of q̇·t, and where s is rounded
    error          (n,) m or rad by which the pieces err at most where they were held against the motion
    """

    start: Array
    length: Array
    coefficients: Array
    noise: Array
    error: Array

    def __post_init__(self) -> None:
        for name in ("start", "length", "coefficients", "noise", "error"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def fit(motion: Motion, tolerance: Array) -> Pieces:
    """Quintics through q, q̇, q̈ at both ends of every knot interval, halved until they meet the motion to rounding.

    The accelerations are one-sided, since q̈ may jump at a knot. A piece is also taken when halving no longer helps (the
    motion's own noise is reached) and it errs by at most `tolerance` (n,), or by what rounding of s makes of q on a
    long way, which is as large where the motion passes slowly: that is the noise then.
    Raises MotionError for a motion that is not smooth between its knots, or has no duration.
    """
    lo, hi = motion.knots[:-1], motion.knots[1:]
    lo, hi = lo[hi > lo], hi[hi > lo]
    if not len(lo):
        raise MotionError(f"the motion ends at {motion.duration} s, where it starts; give it time to move")
    before = np.full((len(lo), len(tolerance)), np.inf)
    fitted: list[tuple[Array, Array, Array]] = []
    reach, speed, drift, worst, rough = np.zeros((5, len(tolerance)))
    for depth in range(HALVINGS):
        coefficients, error, size, rate, along = _quintics(motion, lo, hi)
        reach, speed, drift = np.maximum(reach, size), np.maximum(speed, rate), np.maximum(drift, along)
        noise = ROUNDING * (reach + speed * motion.duration)
        most = np.maximum(tolerance, ROUNDING * (reach + speed * motion.duration + drift))
        good = ((error <= noise) | ((error <= most) & (error > before / 4))).all(axis=1)
        worst = np.maximum(worst, error[good].max(axis=0, initial=0.0))
        rough = np.where(worst > np.maximum(tolerance, noise), worst, 0.0)
        if good.all():
            fitted.append((lo, hi, coefficients))
            break
        fitted.append((lo[good], hi[good], coefficients[:, :, good]))
        lo, hi, before = lo[~good], hi[~good], np.repeat(error[~good], 2, axis=0)
        if depth == HALVINGS - 1 or len(lo) > MOST:
            raise _rough(lo, error[~good], most)
        middle = (lo + hi) / 2
        lo, hi = np.column_stack((lo, middle)).ravel(), np.column_stack((middle, hi)).ravel()
    if len(fitted) == 1:  # in order already, and too much to copy
        ((start, end, coefficients),) = fitted
    else:
        start, end = (np.concatenate([piece[k] for piece in fitted]) for k in (0, 1))
        order = np.argsort(start)
        start, end = start[order], end[order]
        coefficients = np.concatenate([piece[2] for piece in fitted], axis=2)[:, :, order]
    coefficients.flags.writeable = False
    return Pieces(start, end - start, coefficients, np.maximum(noise, rough), worst)


def _rough(lo: Array, error: Array, tolerance: Array) -> MotionError:
    piece, axis = np.unravel_index((error / tolerance).argmax(), error.shape)
    strays, most = apart(error[piece, axis], tolerance[axis], digits=3)
    return MotionError(
        f"axis {axis + 1}: the motion near t = {lo[piece]:.9g} s strays {strays} from any polynomial, "
        f"more than {most}; put a knot where it is not smooth, and give its true q̇ and q̈"
    )


def _quintics(motion: Motion, lo: Array, hi: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Coefficients (n, 6, P), largest error at the probes (P, n), and the largest |q|, |q̇| and s·dq/ds (n,).

    In blocks: a state holds far more than what is kept.
    """
    blocks = [slice(first, first + BLOCK) for first in range(0, len(lo), BLOCK)]
    axes = motion.at(lo[:1]).q.shape[1]
    coefficients, error = np.empty((axes, 6, len(lo))), np.empty((len(lo), axes))
    reach, speed, drift = np.zeros((3, axes))
    for block in blocks:
        coefficients[:, :, block], error[block], size, rate, along = _block(motion, lo[block], hi[block])
        reach, speed, drift = np.maximum(reach, size), np.maximum(speed, rate), np.maximum(drift, along)
    return coefficients, error, reach, speed, drift


def _block(motion: Motion, lo: Array, hi: Array) -> tuple[Array, Array, Array, Array, Array]:
    h = (hi - lo)[:, None]
    # The last instant of an interval still has its own acceleration; the knot itself belongs to the next interval.
    ends = motion.at(np.concatenate((lo, np.nextafter(hi, lo))))
    q, qd, qdd = ends.q, ends.qd, ends.qdd
    (q0, q1), (v0, v1), (a0, a1) = (np.split(values, 2) for values in (q, qd, qdd))
    v0, v1, a0, a1 = v0 * h, v1 * h, a0 * h**2, a1 * h**2
    r, s, w = q1 - q0 - v0 - a0 / 2, v1 - v0 - a0, a1 - a0
    c = np.stack((q0, v0, a0 / 2, 10 * r - 4 * s + w / 2, -15 * r + 7 * s - w, 6 * r - 3 * s + w / 2))
    true = motion.at((lo[:, None] + PROBES * (hi - lo)[:, None]).ravel()).q.reshape(len(lo), len(PROBES), -1)
    ours = np.einsum("ipn,ui->pun", c, PROBES[:, None] ** np.arange(6))
    return (
        c.transpose(2, 0, 1),
        abs(true - ours).max(axis=1),
        abs(q).max(axis=0, initial=0),
        abs(qd).max(axis=0, initial=0),
        _drift(ends.s, q0, q1),
    )


def _drift(s: Array, q0: Array, q1: Array) -> Array:
    """(n,) the largest |s|·|Δq/Δs| of intervals, s (2 P,) at their starts and ends: rounding of s shows so in q."""
    far, way = abs(s).max(initial=0.0), abs(np.diff(s.reshape(2, -1), axis=0)[0])
    seen = way > SEEN * far
    return np.asarray(far * (abs(q1 - q0)[seen] / way[seen, None]).max(axis=0, initial=0.0))
