"""Assembly modes: every pose of a hexapod for given leg lengths, by continuation of all complex solutions.

A pose is a point of projective space: (e, h), with a quaternion e of the rotation and h = p e for the position p, so
that e·h = 0 and p = h e*/(e·e) (Study's quadric). Leg i of length l_i between b_i and a_i, ‖p + R a_i − b_i‖ = l_i,
multiplied by e·e is a quadratic form [Wampler 1996]:

    h·h + 2 h·(e a_i − b_i e) + c_i e·e − 2 (b_i e)·(e a_i) = 0,    c_i = a_i·a_i + b_i·b_i − l_i².

With Study's condition these are seven equations in P⁷. Where e·e = 0 there is no pose. For almost all complex
parameters θ = (a, b, c), 40 solutions remain [Ronga and Vust 1995, Mourrain 1993], and they move smoothly with θ. Two
steps find them:

1. Once, for random complex θ₀: one solution is made by choosing the pose and computing c. Followed round closed loops
   of θ it comes back as another of the 40, since they are branches of one irreducible family (monodromy). New ones are
   sent round again until there are 40.
2. For a machine and its lengths θ₁, all 40 are followed along θ₀ + t (θ₁ − θ₀). This line misses the θ of multiple
   solutions, which have two real dimensions less than all θ, with probability one. So every isolated solution of θ₁ is
   the end of a path; where it has fewer than 40 (coincident or coplanar joints), the other paths lead to e·e = 0.

Two paths that end in the same pose mean that one of them jumped, and of the real θ₁ every solution that is not real has
its conjugate: what breaks these rules is followed again in smaller steps. Real solutions are polished by the machine's
own Newton. [Sommese and Wampler 2005, The Numerical Solution of Systems of Polynomials; Dietmaier 1998]
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.array import Array
from kinematics.continuation import Complex, Equations, follow
from kinematics.errors import MotionError
from kinematics.pose import Pose, from_numbers, numbers

if TYPE_CHECKING:
    from kinematics.hexapod import Hexapod

GENERIC = 40
"""Poses of almost every hexapod, complex ones counted."""
SOLVED = 1e-12
"""Largest |inverse(pose) − q| of what is listed, as a share of the longest leg (of 1 m, if that is more)."""
# Poses (of a machine of size one) nearer than this are the same; solutions whose e·e is smaller are none.
SAME, NONE = 1e-6, 1e-9
# Largest imaginary part of what may be real: a path to a double solution stops some 1e-2 before it.
REAL = 0.1
# How well a prediction must agree with its correction: at first, and where paths are followed again.
TRUST = (1e-4, 1e-6, 1e-8)
# Rounds of loops after which the search for a generic machine's solutions gives up; three suffice as a rule.
ROUNDS = 60


@dataclass(frozen=True, slots=True)
class Legs:
    """Parameters θ of N machines: a, b (N, 6, 3) and c (N, 6)."""

    a: Complex
    b: Complex
    c: Complex

    @staticmethod
    def random(random: np.random.Generator, count: int) -> Legs:
        draws = (random.normal(size=(2, count, *shape)) for shape in ((6, 3), (6, 3), (6,)))
        return Legs(*((real + 1j * imaginary) / np.sqrt(2) for real, imaginary in draws))

    def repeated(self, times: int) -> Legs:
        return Legs(*(np.repeat(x, times, 0) for x in (self.a, self.b, self.c)))


def assembly_modes(machine: Hexapod, q: ArrayLike, *, seed: int = 0) -> Pose:
    """All real poses found for leg lengths q (6,), as one batch: none twice, |inverse(pose) − q| ≤ 1e-12 m.

    Only isolated poses are looked for: not those of a platform that moves on locked legs (base and platform similar).
    seed chooses the generic machine that the search starts from. Raises MotionError for lengths that are none.
    """
    lengths = np.asarray(q, float)
    if lengths.shape != (6,) or not np.isfinite(lengths).all() or not (lengths > 0).all():
        raise MotionError(
            f"machine {machine.name}: assembly modes need six finite lengths above 0 m, not {lengths.tolist()}"
        )
    above, below = machine.platform.mean(0), machine.base.mean(0)
    a, b = machine.platform - above, machine.base - below
    size = float(np.sqrt(((a**2).sum() + (b**2).sum() + (lengths**2).sum()) / 18))
    c = (a**2).sum(1) + (b**2).sum(1) - lengths**2
    target = Legs(*(x[None].astype(complex) for x in (a / size, b / size, c / size**2)))
    y = solutions(target, seed)
    position, rotation = _poses(y)
    real = np.abs(_entries(y).imag).max(1) < REAL
    turn = Rotation.from_matrix(rotation[real].real)
    near = RigidTransform.from_components(size * position[real].real + below - turn.apply(above), turn)
    found = machine.forward(np.tile(lengths, (len(near), 1)), near)
    solved = numbers(found.pose)[found.residual <= SOLVED * max(1.0, lengths.max())]
    return from_numbers(solved[~repeated(solved / np.repeat([size, 1.0], [3, 9]))])


def solutions(target: Legs, seed: int) -> Complex:
    """(M, 8) solutions (e, h) of one machine of size one, M ≤ 40, complex ones among them."""
    legs, start = generic(seed)
    ends, arrived = np.zeros_like(start), np.zeros(len(start))
    suspect = np.ones(len(start), bool)
    for trust in TRUST:
        equations = _equations(legs.repeated(suspect.sum()), target.repeated(suspect.sum()))
        ends[suspect], arrived[suspect] = follow(equations, start[suspect], trust)
        finite = np.abs((ends[:, :4] ** 2).sum(1)) > NONE
        at_end = np.flatnonzero(finite & (arrived == 1))
        values = _entries(ends[at_end])
        apart = np.abs(values[:, None] - values).max(2) + np.diag(np.full(len(values), np.inf))
        conjugate = np.abs(values[:, None] - values.conj()).max(2).min(1, initial=np.inf) < SAME
        suspect = np.zeros(len(start), bool)
        suspect[at_end] = (apart.min(1, initial=np.inf) < SAME) | ~conjugate
        if not suspect.any():
            break
    return np.asarray(ends[finite])


@cache
def generic(seed: int) -> tuple[Legs, Complex]:
    """A random complex machine, and its 40 solutions (40, 8)."""
    random = np.random.default_rng(seed)
    legs = Legs.random(random, 1)
    e, h = random.normal(size=(2, 4)) + 1j * random.normal(size=(2, 4))
    h -= (e @ h) / (e @ e) * e
    y = np.concatenate([e, h])[None]
    y /= np.linalg.norm(y)
    left = np.einsum("j,ijk,k->i", y[0], _forms(legs)[0, :6], y[0])
    legs = Legs(legs.a, legs.b, legs.c - left / (y[0, :4] @ y[0, :4]))
    for _ in range(ROUNDS):
        loops = -(-GENERIC // len(y))
        corners = [legs.repeated(loops), Legs.random(random, loops), Legs.random(random, loops)]
        ends, arrived = np.tile(y, (loops, 1)), np.ones(loops * len(y), bool)
        for k in range(3):
            one, other = (corners[j % 3].repeated(len(y)) for j in (k, k + 1))
            ends, t = follow(_equations(one, other), ends, TRUST[0])
            arrived &= t == 1
        found = np.concatenate([y, ends[arrived]])
        y = found[~repeated(_entries(found))]
        if len(y) == GENERIC:
            return legs, y
    raise MotionError(f"assembly modes: {len(y)} of {GENERIC} solutions found from seed {seed}; take another one")


def repeated(values: Complex | Array) -> np.ndarray:
    """(N,) bool: which rows (N, k) are the same as one before them."""
    same = np.abs(values[:, None] - values).max(2, initial=0.0) < SAME
    return np.asarray(np.tril(same, -1).any(1))


def _equations(start: Legs, end: Legs) -> Equations:
    """Of the legs (N) on the straight line from start to end; their quadratic forms are quadratic in t."""
    middle = Legs(*((x + y) / 2 for x, y in ((start.a, end.a), (start.b, end.b), (start.c, end.c))))
    first, half, last = _forms(start), _forms(middle), _forms(end)
    bend = 2 * (first + last - 2 * half)
    rise = last - first - bend

    def equations(rows: np.ndarray, t: Array, y: Complex) -> tuple[Complex, Complex, Complex]:
        t = t[:, None, None, None]
        forms = first[rows] + t * (rise[rows] + t * bend[rows])
        rate = rise[rows] + 2 * t * bend[rows]
        column = y[:, None, :, None]
        by_y = (forms @ column)[..., 0]
        return (by_y @ y[:, :, None])[..., 0], 2 * by_y, ((rate @ column)[..., 0] @ y[:, :, None])[..., 0]

    return equations


def _forms(legs: Legs) -> Complex:
    """(N, 7, 8, 8) symmetric matrices of the six legs' quadratic forms in (e, h), and of Study's 2 e·h."""
    left, right = np.einsum("nli,ijk->nljk", legs.b, _LEFT), np.einsum("nli,ijk->nljk", legs.a, _RIGHT)
    forms = np.zeros((len(legs.c), 7, 8, 8), complex)
    forms[:, :6, :4, :4] = legs.c[..., None, None] * np.eye(4) + 2 * left @ right  # (b e)·(e a) = −e·(b e a)
    forms[:, :6, 4:, :4] = right - left
    forms[:, :6, :4, 4:] = (right - left).swapaxes(2, 3)
    forms[:, :6, 4:, 4:] = np.eye(4)
    forms[:, 6, 4:, :4] = forms[:, 6, :4, 4:] = np.eye(4)
    return forms


def _poses(y: Complex) -> tuple[Complex, Complex]:
    """Position (N, 3) and rotation (N, 3, 3) of solutions (N, 8): h e*/(e·e), and v ↦ e v e*/(e·e)."""
    e, h = y[:, :4], y[:, 4:]
    left, right = np.einsum("nk,kij->nij", e, _BY_LEFT), np.einsum("nk,kij->nij", e * [-1, -1, -1, 1], _BY_RIGHT)
    square = (e * e).sum(1)
    position = (right @ h[:, :, None])[:, :3, 0] / square[:, None]
    return position, (right @ left)[:, :3, :3] / square[:, None, None]


def _entries(y: Complex) -> Complex:
    """(N, 12) position and rotation of solutions: the same for y and any multiple of it."""
    position, rotation = _poses(y)
    return np.concatenate([position, rotation.reshape(-1, 9)], 1)


def _products() -> tuple[Array, Array]:
    """(4, 4, 4) matrices of the product by the units x, y, z, 1 from the left, and from the right."""
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
