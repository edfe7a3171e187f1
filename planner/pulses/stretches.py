"""Polynomial pieces of one axis, cut so that each runs one way only."""

from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray

from kinematics.array import Array
from planner.pulses.crossing import solve

DEPTH = 48  # halvings of [0, 1]: by then a stretch is narrower than rounding
# Bernstein coefficients of a quartic from its monomial ones. It has as many roots in (0, 1) as they change sign, or
# fewer by an even number: none where they do not, exactly one where they change once.
BERNSTEIN = np.array([[comb(j, i) / comb(4, i) if i <= j else 0.0 for i in range(5)] for j in range(5)])


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


def monotone(start: Array, length: Array, coefficients: Array, slack: float) -> Stretches:
    """The pieces (P,), (P,), (6, P) cut at their turning points; inside a stretch x runs back by no more than `slack`.

    Undecided pieces are halved until the Bernstein coefficients of x′ have one sign, or change it once: there the root
    is found.
    """
    piece, lo, width = np.arange(len(start)), np.zeros(len(start)), np.ones(len(start))
    done: list[tuple[NDArray[np.intp], Array, Array]] = []
    for depth in range(DEPTH + 1):
        slope = derivative(window(coefficients[:, piece], lo, width))
        control = BERNSTEIN @ slope
        decided = (control >= -slack).all(axis=0) | (control <= slack).all(axis=0) | (depth == DEPTH)
        turning = ~decided & (np.count_nonzero(np.diff(control > 0, axis=0), axis=0) == 1)
        done.append((piece[decided], lo[decided], width[decided]))
        if turning.any():
            cut = _root(slope[:, turning]) * width[turning]
            done.append((piece[turning], lo[turning], cut))
            done.append((piece[turning], lo[turning] + cut, width[turning] - cut))
        halve = ~decided & ~turning
        if not halve.any():
            break
        piece, lo, width = np.repeat(piece[halve], 2), np.repeat(lo[halve], 2), np.repeat(width[halve] / 2, 2)
        lo[1::2] += width[1::2]
    piece, lo, width = (np.concatenate([part[i] for part in done]) for i in range(3))
    order = np.lexsort((lo, piece))
    piece, lo, width = piece[order], lo[order], width[order]
    return Stretches(
        start[piece] + lo * length[piece], width * length[piece], window(coefficients[:, piece], lo, width)
    )


def window(coefficients: Array, lo: Array, width: Array) -> Array:
    """Coefficients (6, S) of p(lo + width·v) from those of p, by Horner's shift."""
    shifted = coefficients.copy()
    for first in range(5):
        for i in range(4, first - 1, -1):
            shifted[i] += lo * shifted[i + 1]
    return shifted * width ** np.arange(6)[:, None]


def derivative(coefficients: Array) -> Array:
    """Coefficients (5, S) of p′ from those (6, S) of p."""
    return coefficients[1:] * np.arange(1, 6)[:, None]


def _root(slope: Array) -> Array:
    """The one root in (0, 1) of each quartic (5, S) that changes sign there."""
    rising = slope * np.where(slope[0] > 0, -1.0, 1.0)
    climb = np.vstack((rising[1:], np.zeros(rising.shape[1])))
    every = np.arange(rising.shape[1])
    root, _ = solve(climb, every, -rising[0], np.full(len(every), 4 * np.finfo(float).eps))
    return root
