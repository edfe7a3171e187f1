"""What a limit is: data for the solvers, and a physical quantity for the certificate."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar, Protocol, Self

import numpy as np

from kinematics.analysis.clearance import Bodies
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis, Magnitude, directional_bounds
from planner.limits.lowered import ALL, Shares
from planner.path.actuation import Points

MAX_OVERESTIMATE = 5e-7
"""How far above the largest use that is met its proven bound may stay, where a limit does not say
otherwise.
"""
Quantity = Any
"""An array (N, m), or a guaranteed `Series` of N cells: the same formula computes both."""


class Term(Enum):
    """What a coefficient multiplies."""

    ONE = "1"
    SD = "ṡ"
    SD2 = "ṡ²"
    SD3 = "ṡ³"
    SDD = "s̈"
    SDSDD = "ṡs̈"
    SDDD = "s⃛"

    @property
    def per_time(self) -> int:
        """Its power of 1/time: a motion k times slower has it k^per_time times smaller."""
        return {"1": 0, "ṡ": 1, "ṡ²": 2, "ṡ³": 3, "s̈": 2, "ṡs̈": 3, "s⃛": 3}[self.value]


@dataclass(frozen=True, slots=True)
class Rows:
    """−below ≤ Σ coefficient · term ≤ bound at N grid points: each (N, m); below None: the same as
    bound, which is broadcast; a bound of ∞ says that a channel is free.

    speed_range  least and largest ṡ, each (N, m), at which a row of a limit that is not convex
                 counts. All rows that count at one ṡ keep the limit at every ṡ, with no loss at
                 that one.
    convex_part  rows that every motion within such a limit keeps, at every ṡ
    """

    coefficients: Mapping[Term, Array]
    bound: Array
    below: Array | None = None
    speed_range: tuple[Array, Array] | None = None
    convex_part: "Rows | None" = None

    def scale(self, factor: Array) -> "Rows":
        """As if all bounds were so many times as large, factor (N, 1)."""
        coefficients = {term: values / factor for term, values in self.coefficients.items()}
        speeds = self.speed_range
        speeds = None if speeds is None else (speeds[0] * factor, speeds[1] * factor)
        convex_part = None if self.convex_part is None else self.convex_part.scale(factor)
        return Rows(coefficients, self.bound, self.below, speeds, convex_part)


class LimitState(Protocol):
    """What a limit may look at: a `State`, or its enclosure over cells of time."""

    @property
    def q(self) -> Quantity:
        """(N, n) axis positions, m or rad; of legs their length."""

    @property
    def qd(self) -> Quantity:
        """(N, n) q̇, m/s or rad/s."""

    @property
    def qdd(self) -> Quantity:
        """(N, n) q̈, m/s² or rad/s²."""

    @property
    def qddd(self) -> Quantity:
        """(N, n) q⃛, m/s³ or rad/s³."""

    @property
    def piece(self) -> np.ndarray:
        """(N,) which piece of the path it is on, from 0."""

    def pose_rate(self, times: int) -> Quantity:
        """Return a derivative (N, 12) of the pose's numbers by time, of order 0, 1, 2 or 3.

        x, y, z in the base frame, m, and the rotation matrix row by row. Raises MotionError for
        another order.
        """

    def distances(self, bodies: Bodies) -> Quantity:
        """Between the axes of a machine's bodies (N, k), m."""

    def tool_rate(self, times: int) -> Quantity:
        """The same of the tool: the platform's own numbers where there is none."""

    def evaluate(self, expression: Expression, *inputs: Quantity) -> Quantity:
        """An expression of quantities of this motion, (N, k) each, one after the other."""


class Limit(ABC):
    """One kind of limit on m channels (axes, joints, or the tool).

    A new kind is one file with `value`, `use` and, unless it depends on the pose alone, `rows`, and
    one registry line.
    """

    name: ClassVar[str]
    terms: frozenset[Term] = frozenset()
    """What its rows use; empty for a geometric limit, which slowing down cannot fix."""
    relief: ClassVar[str] = "uses {} less"
    """What a path must do that breaks it by so much."""
    by_axis: ClassVar[bool] = False
    """Whether its value is one derivative of each axis, times a number: then its channels are
    looked at one by one.
    """
    convex: ClassVar[bool] = False
    """Whether it keeps one coordinate's value or rate within bounds that are the same all along:
    then a weighed mean of motions that keep it keeps it.
    """
    channels: tuple[str, ...]
    bounds: Array
    """(m,) SI; ∞ where a channel is free."""
    units: tuple[tuple[str, float], ...]
    """Per channel, the unit that people read and how many of it are one SI unit."""
    shares: Shares = ALL
    """How much of it is planned with along the path: what the solvers keep.

    The certificate judges by all of it.
    """

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {len(self.channels)}>"

    @property
    def binds(self) -> bool:
        """Whether it limits anything at all."""
        return bool((self.bounds < np.inf).any())

    @property
    def content(self) -> Hashable:
        """What decides its value and its use of it: geometric limits of equal content bound the
        same.
        """
        return self

    @property
    def geometric(self) -> bool:
        return not self.terms

    def slowness(self, use: float) -> float:
        """How many times slower a motion must run that uses so much of this limit; 1 where it keeps
        it already.
        """
        return (
            1.0
            if self.geometric
            else max(1.0, use) ** (1 / max(1, min(term.per_time for term in self.terms)))
        )

    def remedy(self, over: float, unit: str) -> str:
        """What to say where it is geometric and exceeded by so much."""
        return f"slowing down cannot fix this: move the path so that it {self.relief.format(f'{over:.4g} {unit}')}"

    @abstractmethod
    def value(self, motion: LimitState) -> Quantity:
        """The physical quantity (N, m); all that the certificate sees of the limit, beside
        `use`.
        """

    @abstractmethod
    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        """Share of the limit (N, m) that values between low and high use at most; 1 is at the
        limit.
        """

    def use_at(self, state: LimitState) -> Array:
        """Return the share of the limit (N, m) that N states use."""
        value = self.value(state)
        return self.use(value, value, state.piece)

    def tight(self, met: Array) -> Array | float:
        """How far above the use that is met a proven bound may stay."""
        return MAX_OVERESTIMATE

    def report_value(self, value: float, channel: int, piece: int) -> tuple[float, float]:
        """A value as people say it and the limit that it is held against on a piece of the path,
        SI.
        """
        return abs(value), float(self.bounds[channel])

    def scale(self, factor: float, channel: int | None = None) -> Self:
        """The same limit with the bounds of a channel, or of all, so many times as large, in both
        directions.

        Raises MotionError where it is no matter of one number.
        """
        if self.geometric:
            raise MotionError(
                f"{self.name} does not depend on timing: changing it saves no time along the same path"
            )
        changed = copy(self)
        factors = np.ones(len(self.bounds))
        factors[channel if channel is not None else slice(None)] = factor
        changed._scale(factors)
        return changed

    def _scale(self, factors: Array) -> None:
        """Multiply what states its bounds by factors (m,)."""
        self.bounds = freeze_array(self.bounds * factors)

    def rows(self, points: Points) -> Rows:
        """What the solvers must keep at N grid points."""
        raise MotionError(f"{self.name} is geometric: it puts no row into a timing problem")

    def lower(self, shares: Shares) -> Self:
        """The same limit, of which solvers use such shares along the path; `value` and `use` stay
        as they are.
        """
        changed = copy(self)
        changed.shares = shares
        return changed


def select_timed(limits: Iterable[Limit]) -> list[Limit]:
    """Return the limits that depend on timing; the others have one value for every timing."""
    return [limit for limit in limits if not limit.geometric]


def order_of(limits: Iterable[Limit]) -> int:
    """3 where any of them holds jerk, else 2: the derivatives of q that they look at."""
    return 3 if any(Term.SDDD in limit.terms for limit in limits) else 2


class AxisLimit(Limit):
    """−below ≤ value ≤ bound, one channel per axis; below (m,) is what holds towards smaller q."""

    dimension: ClassVar[str]
    """What follows the axis' own unit: "", "/s", "/s²", "/s³"."""

    def __init__(self, axes: Sequence[Axis], bounds: Sequence[Magnitude | None]) -> None:
        self.channels = tuple(axis.name for axis in axes)
        self.below, self.bounds = (
            freeze_array(side) for side in zip(*map(directional_bounds, bounds), strict=True)
        )
        self.units = tuple(_UNITS[axis.kind](self.dimension) for axis in axes)

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        return np.asarray(np.maximum(-low / self.below, high / self.bounds) + 0.0)  # no −0

    def report_value(self, value: float, channel: int, piece: int) -> tuple[float, float]:
        return abs(value), float((self.bounds if value > 0 else self.below)[channel])

    def _scale(self, factors: Array) -> None:
        self.bounds, self.below = (
            freeze_array(self.bounds * factors),
            freeze_array(self.below * factors),
        )


_UNITS: dict[str, Callable[[str], tuple[str, float]]] = {
    "linear": lambda per: (f"mm{per}", 1e3),
    "rotary": lambda per: (f"deg{per}", 180 / np.pi),
}
