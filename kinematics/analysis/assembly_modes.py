"""Assembly modes: every pose of a hexapod for given leg lengths, by continuation of all complex
solutions.

A pose is a point of projective space: (e, h), with a quaternion e of the rotation and h = p e for
the position p, so that e·h = 0 and p = h e*/(e·e) (Study's quadric). Leg i of length l_i between
b_i and a_i, ‖p + R a_i − b_i‖ = l_i, multiplied by e·e is a quadratic form [Wampler 1996]:

    h·h + 2 h·(e a_i − b_i e) + c_i e·e − 2 (b_i e)·(e a_i) = 0,    c_i = a_i·a_i + b_i·b_i − l_i².

With Study's condition these are seven equations in P⁷. Where e·e = 0 there is no pose. For almost
all complex parameters θ = (a, b, c), 40 solutions remain [Ronga and Vust 1995, Mourrain 1993], and
they move smoothly with θ. Two steps find them:

1. Once, for random complex θ₀: one solution is made by choosing the pose and computing c. Followed
   round closed loops
   of θ it comes back as another of the 40, since they are branches of one irreducible family
   (monodromy). New ones are
   sent round again until there are 40.
2. For a machine and its lengths θ₁, all 40 are followed along θ₀ + t (θ₁ − θ₀). This line misses
   the θ of multiple
   solutions, which have two real dimensions less than all θ, with probability one. So every
   isolated solution of θ₁ is
   the end of a path; where it has fewer than 40 (coincident or coplanar joints), the other paths
   lead to e·e = 0.

Two paths that end in the same pose mean that one of them jumped, and of the real θ₁ every solution
that is not real has its conjugate: what breaks these rules is followed again in smaller steps. Real
solutions are polished by the machine's own Newton. [Sommese and Wampler 2005, The Numerical
Solution of Systems of Polynomials; Dietmaier 1998]
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.foundation.arrays import LEAST_POSITIVE, Array, finite_array
from kinematics.foundation.errors import MotionError
from kinematics.kinds.legged import Legged
from kinematics.machine.pose import from_numbers, to_numbers

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose

Complex = NDArray[np.complex128]
Equations = Callable[[np.ndarray, Array, Complex], tuple[Complex, Complex, Complex]]
"""(rows (M,) of the batch, t (M,), y (M, n + 1)) -> F (M, n), ∂F/∂y (M, n, n + 1), ∂F/∂t (M, n)."""

# Corrections by Newton after a prediction, and the last one's size by which they count as
# converged.
MAX_CORRECTIONS, CORRECTION_TOLERANCE = 3, 1e-10
# Steps of a solution at most; its first and its shortest.
MAX_STEPS, FIRST_STEP, MIN_STEP = 2000, 0.02, 1e-9


def follow(equations: Equations, y: Complex, trust: float) -> tuple[Complex, Array]:
    """The solutions y (N, n + 1) of t = 0 at t = 1, and the t (N,) that each has reached.

    A solution is a point of projective space, so none can run away: it is kept at length one, and
    each step moves in the plane that touches the sphere in it. Predicted by Runge and Kutta's rule
    of fourth order for ẏ = −(∂F/∂y)⁻¹ ∂F/∂t, corrected by Newton. A step counts if the prediction
    was right within `trust` and Newton converges; each solution takes its own steps, as long as
    that allows. What ends in a multiple solution stays below t = 1, close to it.
    """
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    t, step = np.zeros(len(y)), np.full(len(y), FIRST_STEP)
    active = np.arange(len(y))
    for _ in range(MAX_STEPS):
        active = active[(t[active] < 1) & (step[active] > MIN_STEP)]
        if not len(active):
            break
        now, h = y[active], np.minimum(step[active], 1 - t[active])
        ends = np.where(step[active] < 1 - t[active], t[active] + h, 1.0)
        slopes: list[Complex] = []
        for share in (0.0, 0.5, 0.5, 1.0):
            ahead = now + (share * h)[:, None] * slopes[-1] if slopes else now
            _, by_y, by_t = equations(active, t[active] + share * h, ahead)
            slopes.append(-_solve(by_y, by_t, now))
        trial = now + (h / 6)[:, None] * (slopes[0] + 2 * slopes[1] + 2 * slopes[2] + slopes[3])
        errors = []
        for _ in range(MAX_CORRECTIONS):
            value, by_y, _ = equations(active, ends, trial)
            change = _solve(by_y, value, now)
            trial = trial - change
            errors.append(np.linalg.norm(change, axis=1))
        error = np.nan_to_num(errors[0], nan=np.inf)
        kept = (error < trust) & (errors[-1] < CORRECTION_TOLERANCE)
        y[active[kept]] = trial[kept] / np.linalg.norm(trial[kept], axis=1, keepdims=True)
        t[active[kept]] = ends[kept]
        # the prediction is wrong by h⁵
        longer = 0.8 * (trust / np.maximum(error, 1e-3 * trust)) ** 0.2
        step[active] = h * np.where(kept, np.clip(longer, 0.5, 3.0), np.clip(longer, 0.1, 0.5))
    return y, t


def _solve(matrix: Complex, right: Complex, now: Complex) -> Complex:
    """Solutions (M, n + 1) of matrix (M, n, n + 1) and right (M, n) at right angles to `now` (M, n
    + 1).
    """
    square = np.concatenate([matrix, now.conj()[:, None]], 1)
    full = np.concatenate([right, np.zeros((len(right), 1))], 1)[:, :, None]
    try:
        return np.asarray(np.linalg.solve(square, full)[:, :, 0])
    except np.linalg.LinAlgError:  # one of the batch is singular to the last bit
        return np.asarray((np.linalg.pinv(square) @ full)[:, :, 0])


GENERIC_SOLUTIONS = 40
"""Poses of almost every hexapod, complex ones counted."""
RESIDUAL_SHARE = 1e-12
"""Largest |inverse(pose) − q| of what is listed, as a share of the longest leg (of 1 m, if that is
more).
"""
# Poses (of a machine of size one) nearer than this are the same; solutions whose e·e is smaller are
# none.
SAME_POSE_TOLERANCE, MIN_SQUARED_NORM = 1e-6, 1e-9
# Largest imaginary part of what may be real: a path to a double solution stops some 1e-2 before it.
MAX_IMAGINARY_PART = 0.1
# How well a prediction must agree with its correction: at first, and where paths are followed
# again.
TRUST_TOLERANCES = (1e-4, 1e-6, 1e-8)
# Rounds of loops after which the search for a generic machine's solutions gives up; three suffice
# as a rule.
MAX_LOOP_ROUNDS = 60


@dataclass(frozen=True, slots=True)
class LegParameters:
    """Parameters θ of N machines: a, b (N, 6, 3) and c (N, 6)."""

    a: Complex
    b: Complex
    c: Complex

    @staticmethod
    def random(random: np.random.Generator, count: int) -> LegParameters:
        draws = (random.normal(size=(2, count, *shape)) for shape in ((6, 3), (6, 3), (6,)))
        return LegParameters(*((real + 1j * imaginary) / np.sqrt(2) for real, imaginary in draws))

    def repeat(self, times: int) -> LegParameters:
        return LegParameters(*(np.repeat(x, times, 0) for x in (self.a, self.b, self.c)))


def assembly_modes(machine: Legged, q: ArrayLike, *, seed: int = 0) -> Pose:
    """All real poses found for leg lengths q (6,), as one batch: none twice, |inverse(pose) − q| ≤
    1e-12 m.

    Only isolated poses are looked for: not those of a platform that moves on locked legs (base and
    platform similar). seed chooses the generic machine that the search starts from. Raises
    MotionError for lengths that are none.
    """
    from scipy.spatial.transform import RigidTransform, Rotation

    lengths = finite_array(
        q, f"machine {machine.name}: lengths of its legs", (6,), unit="m", least=LEAST_POSITIVE
    )
    above, below = machine.platform.mean(0), machine.base.mean(0)
    a, b = machine.platform - above, machine.base - below
    size = float(np.sqrt(((a**2).sum() + (b**2).sum() + (lengths**2).sum()) / 18))
    c = (a**2).sum(1) + (b**2).sum(1) - lengths**2
    target = LegParameters(*(x[None].astype(complex) for x in (a / size, b / size, c / size**2)))
    y = solve_modes(target, seed)
    position, rotation = _poses(y)
    real = np.abs(_entries(y).imag).max(1) < MAX_IMAGINARY_PART
    turn = Rotation.from_matrix(rotation[real].real)
    near = RigidTransform.from_components(
        size * position[real].real + below - turn.apply(above), turn
    )
    found = machine.forward(np.tile(lengths, (len(near), 1)), near)
    solved = to_numbers(found.pose)[found.residual <= RESIDUAL_SHARE * max(1.0, lengths.max())]
    return from_numbers(solved[~find_repeats(solved / np.repeat([size, 1.0], [3, 9]))])


def solve_modes(target: LegParameters, seed: int) -> Complex:
    """(M, 8) solutions (e, h) of one machine of size one, M ≤ 40, complex ones among them."""
    legs, start = solve_generic(seed)
    ends, arrived = np.zeros_like(start), np.zeros(len(start))
    suspect = np.ones(len(start), bool)
    for trust in TRUST_TOLERANCES:
        equations = _equations(legs.repeat(suspect.sum()), target.repeat(suspect.sum()))
        ends[suspect], arrived[suspect] = follow(equations, start[suspect], trust)
        finite = np.abs((ends[:, :4] ** 2).sum(1)) > MIN_SQUARED_NORM
        at_end = np.flatnonzero(finite & (arrived == 1))
        values = _entries(ends[at_end])
        apart = np.abs(values[:, None] - values).max(2) + np.diag(np.full(len(values), np.inf))
        conjugate = (
            np.abs(values[:, None] - values.conj()).max(2).min(1, initial=np.inf)
            < SAME_POSE_TOLERANCE
        )
        suspect = np.zeros(len(start), bool)
        suspect[at_end] = (apart.min(1, initial=np.inf) < SAME_POSE_TOLERANCE) | ~conjugate
        if not suspect.any():
            break
    return np.asarray(ends[finite])


@cache
def solve_generic(seed: int) -> tuple[LegParameters, Complex]:
    """A random complex machine, and its 40 solutions (40, 8)."""
    random = np.random.default_rng(seed)
    legs = LegParameters.random(random, 1)
    e, h = random.normal(size=(2, 4)) + 1j * random.normal(size=(2, 4))
    h -= (e @ h) / (e @ e) * e
    y = np.concatenate([e, h])[None]
    y /= np.linalg.norm(y)
    left = np.einsum("j,ijk,k->i", y[0], _forms(legs)[0, :6], y[0])
    legs = LegParameters(legs.a, legs.b, legs.c - left / (y[0, :4] @ y[0, :4]))
    for _ in range(MAX_LOOP_ROUNDS):
        loops = -(-GENERIC_SOLUTIONS // len(y))
        corners = [
            legs.repeat(loops),
            LegParameters.random(random, loops),
            LegParameters.random(random, loops),
        ]
        ends, arrived = np.tile(y, (loops, 1)), np.ones(loops * len(y), bool)
        for k in range(3):
            one, other = (corners[j % 3].repeat(len(y)) for j in (k, k + 1))
            ends, t = follow(_equations(one, other), ends, TRUST_TOLERANCES[0])
            arrived &= t == 1
        found = np.concatenate([y, ends[arrived]])
        y = found[~find_repeats(_entries(found))]
        if len(y) == GENERIC_SOLUTIONS:
            return legs, y
    raise MotionError(
        f"assembly modes: {len(y)} of {GENERIC_SOLUTIONS} solutions found from seed {seed}; take another one"
    )


def find_repeats(values: Complex | Array) -> np.ndarray:
    """(N,) bool: which rows (N, k) are the same as one before them."""
    same = np.abs(values[:, None] - values).max(2, initial=0.0) < SAME_POSE_TOLERANCE
    return np.asarray(np.tril(same, -1).any(1))


def _equations(start: LegParameters, end: LegParameters) -> Equations:
    """Of the legs (N) on the straight line from start to end; their quadratic forms are quadratic
    in t.
    """
    middle = LegParameters(
        *((x + y) / 2 for x, y in ((start.a, end.a), (start.b, end.b), (start.c, end.c)))
    )
    first, half, last = _forms(start), _forms(middle), _forms(end)
    bend = 2 * (first + last - 2 * half)
    rise = last - first - bend

    def equations(rows: np.ndarray, t: Array, y: Complex) -> tuple[Complex, Complex, Complex]:
        t = t[:, None, None, None]
        forms = first[rows] + t * (rise[rows] + t * bend[rows])
        rate = rise[rows] + 2 * t * bend[rows]
        column = y[:, None, :, None]
        by_y = (forms @ column)[..., 0]
        return (
            (by_y @ y[:, :, None])[..., 0],
            2 * by_y,
            ((rate @ column)[..., 0] @ y[:, :, None])[..., 0],
        )

    return equations


def _forms(legs: LegParameters) -> Complex:
    """(N, 7, 8, 8) symmetric matrices of the six legs' quadratic forms in (e, h), and of Study's 2
    e·h.
    """
    left, right = (
        np.einsum("nli,ijk->nljk", legs.b, _LEFT),
        np.einsum("nli,ijk->nljk", legs.a, _RIGHT),
    )
    forms = np.zeros((len(legs.c), 7, 8, 8), complex)
    forms[:, :6, :4, :4] = (
        legs.c[..., None, None] * np.eye(4) + 2 * left @ right
    )  # (b e)·(e a) = −e·(b e a)
    forms[:, :6, 4:, :4] = right - left
    forms[:, :6, :4, 4:] = (right - left).swapaxes(2, 3)
    forms[:, :6, 4:, 4:] = np.eye(4)
    forms[:, 6, 4:, :4] = forms[:, 6, :4, 4:] = np.eye(4)
    return forms


def _poses(y: Complex) -> tuple[Complex, Complex]:
    """Position (N, 3) and rotation (N, 3, 3) of solutions (N, 8): h e*/(e·e), and v ↦ e v
    e*/(e·e).
    """
    e, h = y[:, :4], y[:, 4:]
    left, right = (
        np.einsum("nk,kij->nij", e, _BY_LEFT),
        np.einsum("nk,kij->nij", e * [-1, -1, -1, 1], _BY_RIGHT),
    )
    square = (e * e).sum(1)
    position = (right @ h[:, :, None])[:, :3, 0] / square[:, None]
    return position, (right @ left)[:, :3, :3] / square[:, None, None]


def _entries(y: Complex) -> Complex:
    """(N, 12) position and rotation of solutions: the same for y and any multiple of it."""
    position, rotation = _poses(y)
    return np.concatenate([position, rotation.reshape(-1, 9)], 1)


def _products() -> tuple[Array, Array]:
    """(4, 4, 4) matrices of the product by the units x, y, z, 1 from the left, and from the
    right.
    """
    left, right = np.zeros((4, 4, 4)), np.zeros((4, 4, 4))
    left[3] = right[3] = np.eye(4)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        left[i, i, 3], left[i, 3, i], left[i, k, j], left[i, j, k] = 1, -1, 1, -1
        right[i] = left[i]
        right[i, k, j], right[i, j, k] = -1, 1
    return left, right


_BY_LEFT, _BY_RIGHT = _products()
_LEFT, _RIGHT = _BY_LEFT[:3], _BY_RIGHT[:3]
