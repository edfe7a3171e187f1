"""Rows by which an axis crosses a resonance band in time, where a smooth motion of a stated duration dwells in it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.array import Array
from planner.actuation import ActuatorPath
from planner.limits.limit import Term
from planner.limits.resonance import BELOW, Band
from planner.stays import Stay
from planner.timing.problem import Block, Problem
from planner.trajectory import Trajectory

CROSSING = "crossing"
# Share of the stated time in which a band is crossed: what lies between grid points must not take longer.
IN_TIME = 0.97
# Sizes from which on a row says nothing, against the acceleration and the speed that it is about.
NOTHING = 1e3
# Instants of a stay at which it is looked at.
LOOKED = 65


@dataclass(frozen=True, slots=True)
class Crossing:
    """From s = first to last an axis goes through a band, its |q̇| rising (in time) or falling by `rate` at least.

    Where it starts it is below the band, or above it if it falls; where it ends, on the other side.
    """

    band: Band
    first: float
    last: float
    rising: bool

    @property
    def rate(self) -> float:
        return (self.band.high - self.band.low) / (self.band.time * IN_TIME)


def crossing(path: ActuatorPath, motion: Trajectory, stay: Stay) -> Crossing | None:
    """A stay shortened to the time allowed, about the place where the motion has the band's middle speed.

    At a constant rate of |q̇| that takes (high² − low²)/(2 rate) of the axis' way. None where the motion does not leave
    the band on the other side, or the axis turns back there.
    """
    band = stay.band
    t = np.linspace(stay.start, stay.end, LOOKED)
    state = motion.at(t)
    speed = np.abs(state.qd[:, band.axis])
    middle = (band.low + band.high) / 2
    rising = bool(speed[0] < middle)
    if rising == bool(speed[-1] < middle):
        return None
    k = int(np.argmax((speed >= middle) == rising))
    s, piece = float(state.s[k]), int(state.piece[k])
    slope = abs(float(path.derivatives(np.array([s]), np.array([piece]))[1][0, band.axis]))
    if slope == 0:
        return None
    found = Crossing(band, s, s, rising)
    below = (middle**2 - band.low**2) / (2 * found.rate * slope)
    above = (band.high**2 - middle**2) / (2 * found.rate * slope)
    before, after = (below, above) if rising else (above, below)
    return Crossing(band, s - before, s + after, rising)


def hastened(path: ActuatorPath, problem: Problem, crossings: Sequence[Crossing]) -> Problem:
    """The problem with one more block: two channels for each crossing, its acceleration and the speeds at its ends."""
    if not crossings:
        return problem
    sides: list[dict[Term, Array]] = []
    for s in (problem.s[:-1], problem.s[1:]):
        _, slope, bend, _ = path.derivatives(s, problem.piece)
        terms = {
            term: np.zeros((problem.intervals, 2 * len(crossings))) for term in (Term.ONE, Term.SD, Term.SDD, Term.SD2)
        }
        for n, each in enumerate(crossings):
            _rows(terms, n, each, problem, slope[:, each.band.axis], bend[:, each.band.axis])
        sides.append(terms)
    block = Block(CROSSING, sides[0], sides[1], np.ones(problem.intervals), np.zeros(2 * len(crossings)))
    blocks = [each for each in problem.blocks if each.name != CROSSING]
    return Problem(problem.s, problem.piece, (*blocks, block), problem.speeds)


def _rows(terms: dict[Term, Array], n: int, each: Crossing, problem: Problem, slope: Array, bend: Array) -> None:
    """Each row is rate ≤ d|q̇|/dt ≤ 2 NOTHING rate, or so: 1 about its middle."""
    start, end = problem.s[:-1], problem.s[1:]
    way = np.sign(slope) * (1 if each.rising else -1)
    size = NOTHING * each.rate
    inside = (end > each.first) & (start < each.last) & (start > problem.s[0]) & (end < problem.s[-1])
    terms[Term.SDD][inside, 2 * n] = (way * slope)[inside] / size
    terms[Term.SD2][inside, 2 * n] = (way * bend)[inside] / size
    terms[Term.ONE][inside, 2 * n] = -1 - each.rate / size
    # the intervals just before and just after: one side of the band, and the other
    before, after = np.flatnonzero(end <= each.first)[-1:], np.flatnonzero(start >= each.last)[:1]
    slow, fast = (before, after) if each.rising else (after, before)
    terms[Term.SD][slow, 2 * n + 1] = np.abs(slope)[slow] / (each.band.low * (1 - BELOW))
    fastest = NOTHING * each.band.high
    terms[Term.SD][fast, 2 * n + 1] = np.abs(slope)[fast] / fastest
    terms[Term.ONE][fast, 2 * n + 1] = -1 - each.band.high * (1 + BELOW) / fastest
