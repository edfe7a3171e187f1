"""Where a path stands: places at which no axis moves with the path's parameter, q′ = 0, as where it
turns back.

Whatever ṡ is, the axes are at rest there, q̇ = q′ ṡ. About such a place q − q₀ ~ (s − s₀)ᵐ, mostly
with m = 2: a motion from rest with a bounded acceleration, q − q₀ ~ t², then has ṡ > 0 there, and
one with a bounded jerk, q − q₀ ~ t³, an unbounded s̈. A run that begins or ends there has these
free (planner.timing.problem). Where q″ vanishes too, m > 2, both of what is asked for at rest, ṡ =
0 and s̈ = 0, cost a motion next to nothing, as q hardly changes before s does, but a solver many
steps, as s̈ and s⃛ are without bound there: with m = 3 a motion with a bounded jerk has ṡ > 0, and
is given the largest that there can be.
"""

import numpy as np

from kinematics.foundation.arrays import Array
from planner.path.actuation import ActuatorPath

# Share of its largest value on a piece up to which a derivative of an axis is nothing, where a
# piece is cut and at the ends of what is cut, and of that of any axis: rounding.
ZERO_SHARE, CUT_ZERO_SHARE, DERIVATIVE_ROUNDING = 1e-12, 1e-10, 1e-15
# Points of a piece at which the size of q′ is looked at.
SLOPE_POINTS = 9
# Parts of a piece in which a bound of q″ may show that q′ is nowhere nothing.
BOUND_PARTS = 16
# Share of a piece so near to an end that a place is that, and by which rounding may turn a zero
# complex.
END_SHARE = 1e-6


def count_zero_derivatives(path: ActuatorPath) -> np.ndarray:
    """(2, P) how many derivatives are nothing at the start and at the end of each piece.

    0: it does not stand there; 1: q′ is; 2: q″ as well; 3: q‴ as well, and maybe more.
    """
    count = len(path.breaks) - 1
    share = np.linspace(0.0, 1.0, SLOPE_POINTS)
    s = path.breaks[:-1, None] * (1 - share) + path.breaks[1:, None] * share
    piece = np.repeat(np.arange(count), SLOPE_POINTS)
    found = np.zeros((2, count), int)
    still = np.ones((2, count), bool)
    for derivative in path.derivatives(s.ravel(), piece, 3)[1:]:
        values = derivative.reshape(count, SLOPE_POINTS, -1)
        still &= _is_zero(values[:, [0, -1]], np.abs(values).max(1)[:, None], CUT_ZERO_SHARE).T
        found += still
    return found


def _is_zero(slope: Array, size: Array, share: float = ZERO_SHARE) -> np.ndarray:
    """Whether a derivative (…, n) is nothing beside its size on the piece (…, n)."""
    most = share * size + DERIVATIVE_ROUNDING * size.max(-1, keepdims=True)
    return np.asarray((np.abs(slope) <= most).all(-1))


def cut_at_stands(breaks: Array, coefficients: Array) -> tuple[Array, Array]:
    """Breaks (P+1,) and coefficients (degree+1, P, n), highest power first, cut where the path
    stands inside a piece.

    There, and where it stands at the start of a piece, q′ is made exactly 0: it was, to rounding.
    """
    if len(coefficients) < 3:  # polylines stand nowhere
        return breaks, coefficients
    lengths = np.diff(breaks)
    slope, size = _slope(coefficients, lengths)
    places, parts = [], []
    suspects = set(_find_suspects(slope, size).tolist())
    starts = _is_zero(slope[-1], size)
    for piece, (start, length) in enumerate(
        zip(breaks[:-1].tolist(), lengths.tolist(), strict=True)
    ):
        inside = _inner_stands(slope[:, piece], size[piece]) if piece in suspects else []
        own = coefficients[:, piece].copy()
        if starts[piece] and own[:-2].any():
            own[-2] = 0.0
        places.append(start)
        parts.append(own)
        for share in inside:
            moved = _shift_polynomials(coefficients[:, piece], share * length)
            moved[-2] = 0.0
            places.append(start + share * length)
            parts.append(moved)
    return np.append(places, breaks[-1]), np.stack(parts, 1)


def cut_at_slow_places(breaks: Array, coefficients: Array, share: float) -> tuple[Array, Array]:
    """Cut pieces inside of which q′ comes down to a share of its largest on the path, or to less:
    where it is least.

    |q′|² is a polynomial, least at an end or at a zero of its derivative.
    """
    if len(coefficients) < 3:
        return breaks, coefficients
    lengths = np.diff(breaks)
    powers = np.arange(len(coefficients) - 1, 0, -1)[:, None, None]
    slope = coefficients[:-1] * powers  # by s
    at = np.linspace(0.0, 1.0, SLOPE_POINTS)[:, None, None] * lengths[:, None]
    size = np.abs(np.stack([_evaluate(slope, s) for s in at])).max(2)
    # between places that are looked at it falls as a square does, by no more than this
    suspects = np.flatnonzero(size.min(0) < SUSPECT_SHARE * size.max(0))
    largest = float(size.max(initial=0.0))
    places, parts = [breaks[:-1]], [coefficients]
    for piece in suspects.tolist():
        square = sum(np.convolve(axis, axis) for axis in slope[:, piece].T)
        zeros = np.roots(np.polyder(square))
        inside = (np.abs(zeros.imag) < END_SHARE * lengths[piece]) & (
            zeros.real > END_SHARE * lengths[piece]
        )
        inside &= zeros.real < (1 - END_SHARE) * lengths[piece]
        for s in sorted(zeros[inside].real.tolist()):
            # a zero at an end is a multiple one, which rounding spreads into the piece
            if np.abs(_evaluate(slope[:, piece], s)).max() < min(
                share * largest, *size[[0, -1], piece].tolist()
            ):
                places.append(np.array([breaks[piece] + s]))
                parts.append(_shift_polynomials(coefficients[:, piece], s)[:, None])
    starts = np.concatenate(places)
    order = np.argsort(starts, kind="stable")
    return np.append(starts[order], breaks[-1]), np.concatenate(parts, 1)[:, order]


# Share of a piece's largest q′ below which some place that is looked at must lie, where it may be
# next to nothing.
SUSPECT_SHARE = 0.1


def _slope(coefficients: Array, lengths: Array) -> tuple[Array, Array]:
    """dq/dx over shares x of the pieces, (degree, P, n), highest power first; and a bound of its
    size (P, n).
    """
    powers = np.arange(len(coefficients) - 1, 0, -1)[:, None, None]
    slope = coefficients[:-1] * powers * lengths[:, None] ** powers
    return slope, np.abs(slope).max(0)


def _evaluate(coefficients: Array, x: Array | float) -> Array:
    value = np.zeros(np.broadcast_shapes(coefficients.shape[1:], np.shape(x)))
    for c in coefficients:
        value = value * x + c
    return np.asarray(value)


def _find_suspects(slope: Array, size: Array) -> np.ndarray:
    """The pieces (K,) on which a bound of q″ leaves room for a place at which no axis moves."""
    powers = np.arange(len(slope) - 1, 0, -1)[:, None, None]
    bend = np.abs(slope[:-1] * powers).sum(0)
    least = ZERO_SHARE * size + DERIVATIVE_ROUNDING * size.max(1, keepdims=True)
    suspect = np.zeros(slope.shape[1], bool)
    for middle in (np.arange(BOUND_PARTS) + 0.5) / BOUND_PARTS:
        suspect |= (np.abs(_evaluate(slope, middle)) <= bend / (2 * BOUND_PARTS) + least).all(1)
    return np.flatnonzero(suspect)


def _inner_stands(slope: Array, size: Array) -> list[float]:
    """Shares of one piece, slope (degree, n) and size (n,), at which it stands, but for its ends;
    in order.

    The places are among the zeros of the largest axis' q′, where that has a double one among those
    of its q″, and so on: a multiple zero is a simple one, which rounding does not split, of a
    derivative. Places are one where the path stands half-way between them too.
    """
    most = slope[:, int(np.argmax(size))]
    found: list[float] = []
    while len(most) > 1:
        most = most / np.abs(most).max(initial=1e-300)
        zeros = np.roots(most)
        deeper = [
            float(zero.real)
            for zero in zeros
            if abs(zero.imag) < END_SHARE and END_SHARE < zero.real < 1 - END_SHARE
        ]
        found = deeper + found
        most = np.polyder(most)
    apart = [0.0, 1.0]
    for x in found:  # the truest first
        others = [(x + other) / 2 for other in apart]
        if _is_zero(_evaluate(slope, x), size) and not any(
            _is_zero(_evaluate(slope, other), size) for other in others
        ):
            apart.append(x)
    return sorted(apart[2:])


def _shift_polynomials(coefficients: Array, by: float) -> Array:
    """The polynomials (degree+1, n) in powers from another place: Horner's scheme, again and
    again.
    """
    moved = coefficients.copy()
    for last in range(len(moved) - 1, 0, -1):
        for k in range(1, last + 1):
            moved[k] += by * moved[k - 1]
    return moved
