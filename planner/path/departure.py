"""How far the tool leaves the straight line in synchronised moves, which are straight in the axes alone."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from scipy.spatial.transform import Slerp

from kinematics.foundation.arrays import Array
from kinematics.foundation.table import Column, Table
from kinematics.machine.pose import Pose, from_numbers
from planner.path.actuation import MachinePath
from planner.path.synchronised import NAME
from planner.place import Place, where_columns

MOVE_POINTS = 513
"""Places of a move at which it is looked at; both differences are smooth."""


@dataclass(frozen=True, slots=True)
class Departure:
    """Of one synchronised move, as its pieces have it (blends take its ends).

    distance  m, the farthest that the tool is from the straight line between the move's ends, and where
    turned    rad, the farthest that its orientation is from the one that turns the shorter way in proportion to the
              path; 0 where the machine does not control it
    uneven    pulses, the farthest that any axis is from its own straight way, in proportion to the path
    """

    where: Place
    distance: float
    turned: float
    uneven: float


def departures(path: MachinePath) -> tuple[Departure, ...]:
    """Of every synchronised move of a path, in turn, at LOOKED places of each."""
    names = [piece.shape.name for piece in path.pieces]
    mine = [k for k, name in enumerate(names) if name.split("_")[0] == NAME]
    moves = groupby(mine, lambda k: (path.pieces[k].repetition, path.pieces[k].segment))
    return tuple(_measure_departure(path, list(group)) for _, group in moves)


def departure_tables(found: "Sequence[Departure]") -> tuple[Table, ...]:
    """How far each synchronised move leaves the straight line; no table where there is none."""
    if not found:
        return ()
    columns = (
        *where_columns([one.where for one in found]),
        Column("off the line", [one.distance for one in found], "m", "human", ".4g"),
        Column("turned off", [one.turned for one in found], "rad", "human", ".4g"),
        Column("axes uneven", [one.uneven for one in found], "pulses", form=".2g"),
    )
    return (Table("synchronised moves: straight in the axes, not in space", columns),)


def _measure_departure(path: MachinePath, pieces: Sequence[int]) -> Departure:
    low, high = float(path.breaks[pieces[0]]), float(path.breaks[pieces[-1] + 1])
    share = np.linspace(0.0, 1.0, MOVE_POINTS)
    s = low + share * (high - low)
    piece = np.clip(np.searchsorted(path.breaks, s, side="right") - 1, pieces[0], pieces[-1])
    numbers = path.pose_numbers(s, piece)
    pose = from_numbers(numbers if path.tool is None else path.tool(numbers))
    off = _chord_distance(pose.translation)
    turned = (
        _rotation_departure(pose, share)
        if any(name.startswith("r") for name in path.machine.freedom)
        else np.zeros(MOVE_POINTS)
    )
    q = path.derivatives(s, piece, 0)[0]
    uneven = np.abs(q - (q[0] + share[:, None] * (q[-1] - q[0]))) / [axis.pulse for axis in path.machine.axes]
    k = int(np.argmax(off if off.max() > 0 else turned))
    where = path.place(float(s[k]), int(piece[k]))
    return Departure(where, float(off.max()), float(turned.max()), float(uneven.max()))


def _chord_distance(points: Array) -> Array:
    """(N,) distance from the line between the first and the last."""
    way = points[-1] - points[0]
    length = float(np.linalg.norm(way))
    along = (points - points[0]) @ way / length**2 if length > 0 else np.zeros(len(points))
    return np.asarray(np.linalg.norm(points - points[0] - along.clip(0, 1)[:, None] * way, axis=1))


def _rotation_departure(pose: Pose, share: Array) -> Array:
    ends = pose.rotation[[0, -1]]
    return np.asarray((Slerp([0.0, 1.0], ends)(share).inv() * pose.rotation).magnitude())
