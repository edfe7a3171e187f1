"""Cells of a span, between nodes of a motion: their places and refinement.

All cells prove a bound. These make its loss small.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from kinematics.foundation.arrays import Array
from planner.bounds.spans import Span
from planner.trajectory import Trajectory

# Time of the first cell at a rest, as a share of the span's time.
FIRST_CELL = 1e-3
# Growth of cells from a rest, as a share of the time since.
CELL_GROWTH = 0.15
# Share of a span's time up to which cells grow from a rest.
GROWTH_END = 0.3
# Least number of cells of a span.
LEAST_CELLS = 160
# Least time of a refined cell, as a share of the span's time.
LEAST_CELL = 5e-5
# Greatest number of parts of a cell in one refinement.
MOST_PARTS = 8
# Speed of the first guess relative to the motion: strictly inside the limits.
SLOWER = 0.97
# Share of a cell at rest after which the guess takes its state.
INSIDE = 0.3


@dataclass(frozen=True, slots=True)
class Nodes:
    """Nodes of M cells: s, a = ṡ², b = s̈ and t (M+1,), and the path piece of each cell (M,)."""

    s: Array
    a: Array
    b: Array
    t: Array
    piece: np.ndarray


def place_nodes(trajectory: Trajectory, span: Span) -> Nodes:
    """Return nodes at the motion's knots, and more near rests."""
    knots = span.knots
    begin = knots[0]
    end = knots[-1]
    took = end - begin
    wide = np.maximum(np.diff(knots), took * 1e-12)

    def find_width(t: Array) -> Array:
        interval = np.searchsorted(knots, t, side="right") - 1
        return np.asarray(wide[np.clip(interval, 0, len(wide) - 1)])

    growths = np.log(GROWTH_END / FIRST_CELL) / np.log(1 + CELL_GROWTH)
    powers = np.arange(1 + int(growths))
    since = took * FIRST_CELL * (1 + CELL_GROWTH) ** powers
    growing = np.concatenate([begin + since, end - since])
    away = np.minimum(growing - begin, end - growing)
    growing = growing[find_width(growing) > CELL_GROWTH * away]
    even = np.linspace(begin, end, LEAST_CELLS + 1)
    even = even[find_width(even) > took / LEAST_CELLS]

    inner = np.unique(np.concatenate([knots, even, growing]))
    least = since[0] / 2
    inner = inner[(inner >= begin + least) & (inner <= end - least)]
    return sample_nodes(trajectory, span, np.concatenate([[begin], inner, [end]]))


def sample_nodes(trajectory: Trajectory, span: Span, t: Array) -> Nodes:
    """Return the motion at instants t, and at every break of the path in between."""
    pieces = span.pieces
    breaks = span.breaks
    k = np.clip(trajectory.locate(t), pieces[0], pieces[-1])
    s, v, b = trajectory.advance(k, t - trajectory.knots[k])

    nearest_break = breaks[_find_nearest(breaks, s)]
    clear = np.abs(s - nearest_break) > 1e-10 * np.diff(breaks).min()
    least = 1e-13 * (breaks[-1] - breaks[0])
    apart = np.append(True, np.diff(s) > least)
    inside = (s > breaks[0]) & (s < breaks[-1]) & apart & clear
    # a break takes the state at the nearest instant
    instants = np.append(np.flatnonzero(inside), _find_nearest(s, breaks))
    places = np.append(s[inside], breaks)
    places, chosen = np.unique(places, return_index=True)
    chosen = instants[chosen]
    within = np.searchsorted(breaks, places[:-1], side="right") - 1
    piece = span.first + np.clip(within, 0, len(breaks) - 2)
    a = np.maximum(v[chosen], 0.0) ** 2
    return Nodes(places, a, b[chosen], np.maximum.accumulate(t[chosen]), piece)


def _find_nearest(sorted_values: Array, values: Array) -> np.ndarray:
    """Return the index of the nearest of sorted values for each of the values."""
    middles = (sorted_values[1:] + sorted_values[:-1]) / 2
    return np.searchsorted(middles, values)


def thin_nodes(nodes: Nodes, most: int) -> Nodes:
    """Join cells evenly to about `most`, and keep every break of the path."""
    count = len(nodes.piece)
    if count <= most:
        return nodes
    breaks = np.flatnonzero(np.diff(nodes.piece)) + 1
    ends = np.union1d(np.linspace(0, count, most + 1).round().astype(int), breaks)
    return Nodes(
        nodes.s[ends],
        nodes.a[ends],
        nodes.b[ends],
        nodes.t[ends],
        nodes.piece[ends[:-1]],
    )


def refine_nodes(
    trajectory: Trajectory,
    span: Span,
    nodes: Nodes,
    loss: Array,
    most: float,
) -> Nodes:
    """Return about `most` cells, with more where the loss is larger.

    The loss rate is quadratic in the width of a cell.
    """
    times = np.diff(nodes.t)
    loss = np.where(np.isfinite(loss), loss, np.inf)
    loss = np.minimum(loss, times)
    least_loss = 1e-4 * np.abs(loss).mean() + 1e-300
    share = np.cbrt(np.maximum(loss, least_loss))
    target = np.round(share / share.sum() * most)
    least = LEAST_CELL * (nodes.t[-1] - nodes.t[0])
    room = np.maximum(times / least, 1)
    parts = np.clip(np.clip(target, 1, MOST_PARTS), 1, room).astype(int)
    # cells at rest stay: rounding of s allows no shorter times there
    parts[[0, -1]] = 1
    firsts = np.cumsum(parts) - parts
    within = np.arange(parts.sum()) - np.repeat(firsts, parts)
    starts = np.repeat(nodes.t[:-1], parts)
    t = starts + within * np.repeat(times / parts, parts)
    return sample_nodes(trajectory, span, np.unique(np.append(t, nodes.t[-1])))


def guess_motion(trajectory: Trajectory, nodes: Nodes) -> Array:
    """Return a, b, c of a slightly slower motion at both ends of each cell (M, 2, 3).

    An end at rest takes the state of a place inside its cell.
    """
    least_time = 1e-15 * (nodes.t[-1] - nodes.t[0])
    times = np.maximum(np.diff(nodes.t), least_time)
    # of a cell that takes no more time than rounding, the mean speed is no speed of the motion
    mean = np.minimum(np.diff(nodes.s) / times, np.sqrt(nodes.a.max()))[:, None]
    ends = sliding_window_view(nodes.t, 2)
    rests = sliding_window_view(nodes.a, 2) < 1e-6 * mean**2
    inside = INSIDE * ends[:, ::-1] + (1 - INSIDE) * ends
    instants = np.where(rests, inside, ends)

    k = trajectory.locate(ends.mean(1))[:, None].repeat(2, 1)
    lengths = np.diff(trajectory.knots)
    tau = np.clip(instants - trajectory.knots[k], 0.0, lengths[k])
    _, v, b = trajectory.advance(k, tau)
    v = np.maximum(v, 0.05 * mean) * SLOWER
    c = SLOWER**3 * trajectory.j[k] / v
    return np.stack([v**2, SLOWER**2 * b, c], -1)
