"""A motion behind input shapers over cells of time, with guaranteed error: axes, and the pose that
they reach.

The axes are sums of enclosures of the motion's copies. The pose x_s that they reach is sought about
x_c, the one on the
path where the motion was `centre` earlier: of the twist ξ from x_c to x_s, scaled so that turns
count at the machine's
characteristic length, J ξ = δ = q_s − q_c with J the mean of the Jacobian on the way. With C about
the inverse of J and
K ≥ |1 − C J| over the cell and all poses within a box of x_c, |C δ| + K b ≤ b for the box's half
sides b proves that
there is such a pose in the box (Krawczyk's operator), and K's norm below 1 that it is the only one.
At every instant
|ξ − C δ| ≤ K |ξ|, of second order, so that x_s is known as C δ is, over time. Rates follow from J V = q̇_s and
J V̇ + h(x_s, V) = q̈_s, with J at x_s: with E = 1 − C J, V = C q̇_s + E C q̇_s + E² V.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.taylor_model import EPS, Series
from kinematics.machine.kind import columns
from planner.certificate.cells import Cells
from planner.certificate.enclosure import Enclosure, bound_series, shift_motion, widen
from planner.path.actuation import MachinePath, check_rate
from planner.shaping.shaped_motion import ShapedMotion
from planner.trajectory import Trajectory

ORDER, JACOBIAN_ORDER = 6, 3
"""Of the expansions in time: of the motion, and of the Jacobian."""
ROOM = 3.0
"""Times the pose's first estimate that the box about it has."""
NEAREST_STEPS = 4
"""Of Newton's method, to the place on the path that is nearest to the tool."""


@dataclass(frozen=True)
class ShapedEnclosure(Enclosure):
    """The shaped motion over N cells, as `Enclosure` has it: rows about each centre, then over the
    whole cell.

    s, piece  of the motion `centre` earlier;  axes: q_s (order+1, 2N, n);  apart: δ = q_s − q_c
              likewise
    pieces    (K, N) path pieces of the copies
    """

    axes: Series
    apart: Series
    pieces: NDArray[np.intp]

    def axis_rate(self, times: int) -> Series:
        return self.axes.differentiate(times, self.rate)

    @cached_property
    def reached(self) -> "_ReachedPoses":
        """The pose: its twist from x_c, and the Jacobian's inverse about it."""
        return _ReachedPoses.of(self)

    @cached_property
    def pose(self) -> Series:
        path = self.path
        assert isinstance(path, MachinePath)
        inputs = self.reached.inputs
        return (
            path.machine.carried_map.enclose_columns(inputs)
            if path.machine.follows
            else inputs[:, :12]
        )

    @cached_property
    def twist(self) -> Series:
        """[v, ω] (2N, 6) of the platform in the base frame, with what follows filled in."""
        return self._fill(self.reached.solve(self.qd))[0]

    @cached_property
    def twist_rate(self) -> Series:
        """Its derivative."""
        velocity = self.reached.solve(self.qd)
        still = _zeros_like(velocity)
        n = self.axes.mid.shape[2]
        bent = self._rates(velocity, still)[:, n : 2 * n]
        return self._fill(velocity, self.reached.solve(self.qdd - bent))[1]

    def pose_rate(self, times: int) -> Series:
        if check_rate(times) == 3:
            raise MotionError(
                "the third derivative of the pose is not bounded after input shapers: leave out max_tool_jerk and own "
                "limits of it, or the shapers"
            )
        if times == 0:
            return self.pose
        rotation = self.pose[:, 3:12]
        turn = self.twist[:, 3:]
        if times == 1:
            return _side_by_side(self.twist[:, :3], _cross_columns(turn, rotation))
        swing = _cross_columns(turn, _cross_columns(turn, rotation))
        return _side_by_side(
            self.twist_rate[:, :3], _cross_columns(self.twist_rate[:, 3:], rotation) + swing
        )

    def _rates(self, velocity: Series, acceleration: Series) -> Series:
        """What `rates_map` says at the pose reached, of scaled twists."""
        path = self.path
        assert isinstance(path, MachinePath)
        unscaled = (_spread(each, path) for each in (velocity, acceleration))
        return path.machine.rates_map.enclose_columns(self.reached.inputs, *unscaled)

    def _fill(self, velocity: Series, acceleration: Series | None = None) -> tuple[Series, Series]:
        path = self.path
        assert isinstance(path, MachinePath)
        acceleration = _zeros_like(velocity) if acceleration is None else acceleration
        if not path.machine.follows:
            return _spread(velocity, path), _spread(acceleration, path)
        n = self.axes.mid.shape[2]
        found = self._rates(velocity, acceleration)
        return found[:, 2 * n : 2 * n + 6], found[:, 2 * n + 6 : 2 * n + 12]

    def away(self) -> tuple[Array, Array]:
        """(N,) m of the tool's position, and rad of the platform's turn, from those on the path:
        upper bounds.
        """
        path = self.path
        assert isinstance(path, MachinePath)
        cells = len(self.piece)
        zero = np.zeros((1, 2 * cells, self.axes.mid.shape[2]))
        box = Series(zero, np.tile(self.reached.box, (2, 1))[None], 0)
        twist = self._fill(box)[0]
        most = (np.abs(twist.mid[0]) + twist.rad[0])[cells:] * (1 + 16 * EPS)
        shift, turn = (
            np.linalg.norm(each, axis=1) * (1 + 16 * EPS) for each in (most[:, :3], most[:, 3:])
        )
        if path.tool is not None:  # its place in the platform turns with it
            at = path.tool(np.concatenate([np.zeros(3), np.eye(3).ravel()])[None])[0, :3]
            shift = shift + turn * float(np.linalg.norm(at)) * (1 + 16 * EPS)
        return shift, turn

    def contour(self) -> tuple[Array, Array]:
        """(N,) m of the tool's position from the path, wherever on it: an upper bound; and what it
        is in the middles.

        Any place on the path bounds it, so the path is enclosed at u(τ), which keeps abreast of the
        tool: u(0) is nearest to it, and from there u runs with the tool's motion along the path's
        tangent.
        """
        path, cells = self.path, len(self.piece)
        assert isinstance(path, MachinePath)
        at = self.tool_rate(0)[:, :3]
        whole = np.nan_to_num(at.pad(at.order).mid[:, :cells])
        s, piece, tangent, least = _find_nearest(path, whole[0], self.s.mid[0, :cells], self.piece)
        along = np.einsum(
            "knj,nj->kn", whole, tangent / np.maximum((tangent**2).sum(1, keepdims=True), 1e-12)
        )
        along[0] = s
        low, high = path.breaks[piece], path.breaks[piece + 1]
        reach = np.abs(along[1:]).sum(0)
        inside = np.clip(
            s, low + reach, np.maximum(high - reach, low + reach)
        )  # where all of u is on the piece
        along[0] = np.where(2 * reach <= high - low, inside, (low + high) / 2)
        along[1:] *= np.where(2 * reach <= high - low, 1.0, 0.0)
        error = np.concatenate([np.zeros_like(along), widen(along, np.zeros_like(along))], 1)
        beside = path.enclose_pose(
            Series(np.concatenate([along, along], 1), error, at.order), np.tile(piece, 2)
        )
        beside = beside if path.tool is None else self.evaluate(path.tool, beside)
        off = np.maximum(*np.abs(bound_series(at - beside[:, :3], cells)))
        bound = np.linalg.norm(off, axis=1) * (1 + 16 * EPS)
        return np.where(np.isfinite(bound), bound, np.inf), least


def _find_nearest(
    path: MachinePath, at: Array, s: Array, piece: NDArray[np.intp]
) -> tuple[Array, NDArray[np.intp], Array, Array]:
    """Places s (N,) on pieces (N,) near to positions (N, 3), sought from others; the tangents and
    distances there.
    """
    for last in (*[False] * NEAREST_STEPS, True):
        x, first, second = (
            (values if path.tool is None else path.tool(values))[:, :3]
            for values in path.pose_derivatives(s, piece, 2)
        )
        if last:
            break
        square = (first**2).sum(1)
        bend = square - ((at - x) * second).sum(1)
        step = ((at - x) * first).sum(1) / np.where(
            bend > square / 4, bend, np.maximum(square, 1e-12)
        )
        s = np.clip(s + step, 0.0, path.breaks[-1])
        piece = np.clip(np.searchsorted(path.breaks, s, side="right") - 1, 0, len(path.breaks) - 2)
    return s, piece, first, np.linalg.norm(at - x, axis=1)


@dataclass(frozen=True, slots=True)
class _ReachedPoses:
    """inputs  what the machine's maps take at the poses reached (2N rows)
    inverse  C (N, n, n);  error: E (2N, n, n) there;  most: |E| (N, n, n);  box: |ξ| (N, n) m, ∞
             where none is proved

    A series about an instant is that of x_c(t) and C δ(t), off by what ξ − C δ is at one instant t*
    of the cell: it is right at that t*, whichever that is, and says nothing of how ξ changes.
    """

    inputs: Series
    inverse: Array
    error: Series
    most: Array
    box: Array

    @staticmethod
    def of(motion: ShapedEnclosure) -> "_ReachedPoses":
        path, cells = motion.path, len(motion.piece)
        assert isinstance(path, MachinePath)
        n = motion.axes.mid.shape[2]
        piece = np.tile(motion.piece, 2)
        at = path.enclose_inputs(motion.s.cut(JACOBIAN_ORDER), piece)
        centre = (
            path.jacobian(motion.s.cut(JACOBIAN_ORDER), piece).mid[0, :cells].reshape(cells, n, n)
        )
        good = np.isfinite(centre).all((1, 2)) & (np.abs(np.linalg.det(np.nan_to_num(centre))) > 0)
        inverse = np.linalg.inv(np.where(good[:, None, None], np.nan_to_num(centre), np.eye(n)))
        low, high = bound_series(_apply(np.tile(inverse, (2, 1, 1)), motion.apart), cells)
        first = np.maximum(np.abs(low), np.abs(high)) * (1 + 1e-9)
        box = np.maximum(ROOM * first, first.max(1, keepdims=True)) + 1e-13
        still = _zeros_like(motion.apart)
        _, most = _inverse_error(inverse, _move(at, still, box, box, path), path)
        with np.errstate(invalid="ignore"):
            near = _apply_bound(most, box)
            proved = good & (first + near <= box).all(1) & (most.sum(2).max(1) < 1 - 1e-9)
            near = np.where(proved[:, None], _apply_bound(most, first + near), box)
        box = np.where(proved[:, None], first + near, box)
        inputs = _move(
            at,
            _apply(np.tile(inverse, (2, 1, 1)), motion.apart.cut(JACOBIAN_ORDER)),
            near,
            box,
            path,
        )
        error, most = _inverse_error(inverse, inputs, path)
        most = np.where(proved[:, None, None], most, np.inf)
        return _ReachedPoses(inputs, inverse, error, most, np.where(proved[:, None], box, np.inf))

    def solve(self, right: Series) -> Series:
        """The scaled twists y (2N, n) with J y = right."""
        cells = len(self.box)
        first = _apply(np.tile(self.inverse, (2, 1, 1)), right)
        second = _apply_series(self.error, first)
        low, high = bound_series(first, cells)
        size = np.maximum(np.abs(low), np.abs(high)).max(1)
        with np.errstate(invalid="ignore", divide="ignore"):
            norm = self.most.sum(2).max(1)
            bound = size / (1 - norm) * (1 + 1e-9)
            rest = (self.most @ self.most).sum(2) * bound[:, None] * (1 + 1e-9)
        rest = np.where((norm < 1)[:, None] & np.isfinite(rest), rest, np.inf)
        found = first + second
        rad = found.rad.copy()
        rad[0] += np.tile(rest, (2, 1))
        return Series(found.mid, rad, found.order)


def enclose_shaped(motion: ShapedMotion, trajectory: Trajectory, cells: Cells) -> ShapedEnclosure:
    """The shaped motion over cells of its intervals between knots."""
    half = (cells.hi - cells.lo) / 2
    # what rounding the instants of the copies to their own time may shift them
    half = half * (1 + 2 * EPS) + 8 * EPS * motion.duration
    centre = motion.knots[cells.k] + (cells.lo + cells.hi) / 2
    rate = np.concatenate([1 / half, 1 / half])[:, None]
    copies, axes = motion.copies, None
    pieces: list[NDArray[np.intp]] = []
    for k, weight in enumerate(copies.weights):
        s, piece = _expand(trajectory, motion.whose[k, cells.k], centre - copies.delays[k], half)
        own = trajectory.path.enclose(s, np.tile(piece, 2)) * weight
        axes, pieces = own if axes is None else axes + own, [*pieces, piece]
    s, piece = _expand(trajectory, motion.whose[-1, cells.k], centre - copies.centre, half)
    assert axes is not None  # there is a copy
    apart = axes - trajectory.path.enclose(s, np.tile(piece, 2))
    return ShapedEnclosure(trajectory.path, s, rate, piece, axes, apart, np.array(pieces))


def _expand(
    trajectory: Trajectory, whose: NDArray[np.intp], centre: Array, half: Array
) -> tuple[Series, NDArray[np.intp]]:
    """s of a copy (order+1, 2N) as series in τ about instants `centre` of its own time, and its
    path pieces (N,).

    Before and after the copy's own motion it stands still at its ends.
    """
    last = len(trajectory.s) - 1
    k = np.clip(whose, 0, last)
    moves = (whose >= 0) & (whose <= last)
    end = np.where(whose > last, trajectory.knots[last + 1] - trajectory.knots[last], 0.0)
    at = np.where(moves, centre - trajectory.knots[k], end)

    motion = np.stack([trajectory.s[k], trajectory.v[k], trajectory.a[k], trajectory.j[k]])
    sizes = shift_motion(np.abs(motion), np.abs(at))
    # an instant of a copy's own time is known to a few roundings of the whole time
    late = (
        8
        * EPS
        * trajectory.knots[-1]
        * np.stack([sizes[1], 2 * sizes[2], 3 * sizes[3], np.zeros_like(half)])
    )
    powers = np.stack([np.ones_like(half), half, half**2, half**3])
    powers[1:] *= moves
    mid = shift_motion(motion, at) * powers
    rad = (32 * EPS * sizes + late * (1 + 8 * EPS)) * powers
    series = Series(np.concatenate([mid, mid], 1), np.concatenate([rad, widen(mid, rad)], 1), ORDER)
    return series, trajectory.piece[k]


def _scale(path: MachinePath) -> Array:
    """(n,) m per unit of each freedom: turns count at the characteristic length."""
    return np.where(columns(path.machine) < 3, 1.0, path.machine.characteristic_length)


def _spread(scaled: Series, path: MachinePath) -> Series:
    """Scaled twists of what the machine controls (…, n) as twists (…, 6)."""
    free, scale = columns(path.machine), _scale(path)
    out = Series.zeros(scaled.order, (scaled.mid.shape[1], 6)).cut(scaled.degree)
    own = scaled * (1 / scale)
    out.mid[: own.degree + 1, :, free], out.rad[: own.degree + 1, :, free] = own.mid, own.rad
    return Series(out.mid, out.rad, scaled.order)


def _inverse_error(inverse: Array, inputs: Series, path: MachinePath) -> tuple[Series, Array]:
    """E = 1 − C J (2N, n, n) at poses, and what |E| is at most over each cell (N, n, n)."""
    cells, n = inverse.shape[:2]
    entries = path.machine.jacobian_map.enclose_columns(inputs)
    chosen = (6 * np.arange(n)[:, None] + columns(path.machine)).ravel()
    flat = entries[:, chosen] * np.tile(1 / _scale(path), n)
    jacobian = Series(
        flat.mid.reshape(-1, 2 * cells, n, n), flat.rad.reshape(-1, 2 * cells, n, n), flat.order
    )
    error = -_multiply(np.tile(inverse, (2, 1, 1)), jacobian) + np.eye(n)
    flat = Series(
        error.mid.reshape(-1, 2 * cells, n * n),
        error.rad.reshape(-1, 2 * cells, n * n),
        error.order,
    )
    low, high = bound_series(flat, cells)
    return error, np.nan_to_num(np.maximum(np.abs(low), np.abs(high)), nan=np.inf).reshape(
        cells, n, n
    )


def _apply_bound(most: Array, box: Array) -> Array:
    """(N, n) what matrices of such entries make of such columns at most."""
    return (most @ box[:, :, None])[:, :, 0] * (1 + 1e-9)


def _move(inputs: Series, twist: Series, off: Array, box: Array, path: MachinePath) -> Series:
    """The maps' inputs at poses moved by scaled twists (…, 2N, n), each known within `off` and at
    most `box` (N, n).

    R = exp[ω] R_c = R_c + ω × R_c and a rest, of which no entry is above |ω|²/2.
    """
    rad = twist.rad.copy()
    rad[0] += np.tile(off, (2, 1))
    moved = _spread(Series(twist.mid, rad, twist.order), path)
    place, rotation = inputs[:, :3] + moved[:, :3], inputs[:, 3:12]
    rotation = rotation + _cross_columns(moved[:, 3:], rotation)
    angles = (box / _scale(path))[:, columns(path.machine) >= 3]
    rotation.rad[0] += np.tile(0.5 * np.sum(angles**2, 1, keepdims=True) * (1 + 16 * EPS), (2, 1))
    return _side_by_side(place, rotation, inputs[:, 12:])


def _multiply(matrix: Array, series: Series) -> Series:
    """Numbers (N, n, n) times a series of matrices (d+1, N, n, n)."""
    mid, size = matrix[None] @ series.mid, np.abs(matrix)[None]
    rad = size @ series.rad + 2 * (matrix.shape[1] + 2) * EPS * (
        size @ (np.abs(series.mid) + series.rad)
    )
    return Series(mid, rad * (1 + 8 * EPS), series.order)


def _apply(matrix: Array, series: Series) -> Series:
    """Numbers (N, n, n) times a series of columns (d+1, N, n)."""
    found = _multiply(matrix, Series(series.mid[..., None], series.rad[..., None], series.order))
    return Series(found.mid[..., 0], found.rad[..., 0], series.order)


def _apply_series(matrices: Series, series: Series) -> Series:
    """A series of matrices (…, N, n, n) times one of columns (…, N, n)."""
    n = series.mid.shape[2]
    parts = [matrices[:, :, k] * series[:, k : k + 1] for k in range(n)]
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


def _cross_columns(turn: Series, rotation: Series) -> Series:
    """ω× R (…, 9), row by row, of ω (…, 3) and R (…, 9)."""
    x, y, z = (turn[:, k : k + 1] for k in range(3))
    first, second, third = (rotation[:, 3 * k : 3 * k + 3] for k in range(3))
    rows = (y * third - z * second, z * first - x * third, x * second - y * first)
    return _side_by_side(*rows)


def _zeros_like(series: Series) -> Series:
    return Series(np.zeros_like(series.mid[:1]), np.zeros_like(series.rad[:1]), series.order)


def _side_by_side(*parts: Series) -> Series:
    order = min(part.order for part in parts)
    degree = min(max(part.degree for part in parts), order)
    padded = [part.cut(order).pad(degree) for part in parts]
    return Series(
        np.concatenate([part.mid for part in padded], 2),
        np.concatenate([part.rad for part in padded], 2),
        order,
    )
