"""Limits of which less is planned with on stretches of the path: the share of a limit, as a
function of path length.
"""

from dataclasses import dataclass

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array, freeze_fields


@dataclass(frozen=True, slots=True)
class Shares:
    """Of a limit, between which places of the path so much is planned with; outside of them all of
    it.

    ends    (K+1,) m, rising
    values  (K,) above 0, at most 1: between ends k and k+1
    """

    ends: Array
    values: Array

    def __post_init__(self) -> None:
        freeze_fields(self, "ends", "values")

    @property
    def least(self) -> float:
        """The least of them."""
        return float(self.values.min(initial=1.0))

    @property
    def lowered_length(self) -> float:
        """m of the path on which it is below 1."""
        return float(np.diff(self.ends)[self.values < 1].sum())

    def at(self, s: Array) -> Array:
        """(N,) the share at places s (N,) m."""
        return self.least_over(s, s)

    def least_over(self, first: Array, last: Array) -> Array:
        """(N,) the least share from places first (N,) to last (N,) m, both included."""
        ends = np.concatenate([[-np.inf], self.ends, [np.inf]])
        padded = np.concatenate([[1.0], self.values, [1.0, 1.0]])
        begin, end = (
            np.searchsorted(ends, first, side="left") - 1,
            np.searchsorted(ends, last, side="right"),
        )
        return np.asarray(
            np.minimum.reduceat(padded, np.stack([np.maximum(begin, 0), end], 1).ravel())[::2]
        )

    def on_grid(self, s: Array) -> Array:
        """(N,) of grid points s (N,) m, in any order: the least share up to the points next to
        each.

        Both would miss a stretch between two points otherwise.
        """
        places, whose = np.unique(s, return_inverse=True)
        found = self.least_over(
            np.append(places[:1], places[:-1]), np.append(places[1:], places[-1:])
        )
        return np.asarray(found[whose])

    def lower(self, first: Array, last: Array, factor: Array) -> "Shares":
        """These times the least of the factors (K,) whose stretches, from first (K,) to last (K,)
        m, hold a place.
        """
        ends = np.unique(np.concatenate([self.ends, first, last]))
        less = np.ones(len(ends) - 1)
        begins, stops = np.searchsorted(ends, first), np.searchsorted(ends, last)
        for begin, stop, each in zip(begins.tolist(), stops.tolist(), factor.tolist(), strict=True):
            np.minimum(less[begin:stop], each, out=less[begin:stop])
        return Shares(freeze_array(ends), freeze_array(less * self.at((ends[1:] + ends[:-1]) / 2)))


ALL = Shares(freeze_array(np.zeros(0)), freeze_array(np.zeros(0)))
"""All of a limit everywhere."""
