"""Containment: the proof that a machine can go everywhere in a box of positions, at one
orientation.

Over a cell of positions with centre c and half sides d, axis coordinates and cosines of tilts are
enclosed in ball arithmetic, from the same expressions that evaluate them, and no clearance is
smaller than that in c by more than ‖d‖ (see `Bodies`). What is inside all limits so is inside as a
whole: faces, edges, corners and everything between. Cells that fail are halved in every direction,
until a point of one is found outside, or they are too small.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.analysis.clearance import clearance_use
from kinematics.analysis.margins import USE_ROUNDING, limits_used
from kinematics.foundation.arrays import Array, finite_array, freeze_array
from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.foundation.taylor_model import Series
from kinematics.machine.kind import refuse_uncontrolled

if TYPE_CHECKING:
    from kinematics.machine.machine import Machine

KINDS = ("travel", "tilt", "clearance", "room")
"""The limits that a position can break, in the order of `uses`."""
MAX_CELLS = 200_000
"""Cells that one proof looks at, at most, in one round of halving."""


@dataclass(frozen=True, slots=True)
class Containment:
    """Whether a box is inside all limits.

    holds   proved
    place   (3,) m a position that is outside, or near which the proof failed; None where it holds
    reason  what is wrong there, in words
    """

    holds: bool
    place: Array | None
    reason: str

    def __bool__(self) -> bool:
        return self.holds


def pose_rows(position: Array, rotation: Rotation) -> Array:
    """Pose numbers (N, 12) of positions (N, 3) at one orientation."""
    return np.concatenate(
        [position, np.broadcast_to(rotation.as_matrix().reshape(1, 9), (len(position), 9))], 1
    )


def uses(machine: Machine, rotation: Rotation, position: Array) -> Array:
    """(N, 4) the largest use of travel, tilt, clearance and room at positions (N, 3); ∞ where no
    coordinates exist.
    """
    x = pose_rows(position, rotation)
    with np.errstate(invalid="ignore"):
        q = machine.inverse_map(machine.inputs(x, machine.home_q))
        travel, tilt, clearance, room = limits_used(machine, x, q)
    contact = machine.bodies.contact if machine.bodies else np.zeros(0)
    columns = (travel, tilt, clearance_use(clearance, contact), room)
    found = np.stack([column.max(1, initial=0.0) for column in columns], 1)
    exists = np.asarray(np.isfinite(q).all(1))
    return np.where(exists[:, None] & ~np.isnan(found), found, np.inf)


def prove_cells(machine: Machine, rotation: Rotation, centre: Array, half: Array) -> np.ndarray:
    """(N,) bool: proved that the cells centre ± half (N, 3) are inside all limits."""
    x = [Series(c[None], h[None], 0) for c, h in zip(centre.T, half.T, strict=True)]
    x += [Series.constant(entry, 0) for entry in pose_rows(centre, rotation)[:, 3:].T]
    near = [
        Series.constant(np.full(len(centre), value), 0)
        for value in machine.home_q
        if machine.branched
    ]
    low, high = np.array(machine.room, float).T
    slack = USE_ROUNDING * (high - low) / 2
    inside = np.asarray(((centre - half >= low - slack) & (centre + half <= high + slack)).all(1))
    for axis, home, q in zip(
        machine.axes, machine.home_q, machine.inverse_map.enclose([*x, *near]), strict=True
    ):
        lo, hi = axis.travel
        slack = USE_ROUNDING * (hi - lo) / 2
        inside &= np.isfinite(q.rad[0])
        if np.isfinite(hi):
            inside &= (q.mid[0] - q.rad[0] >= home + lo - slack) & (
                q.mid[0] + q.rad[0] <= home + hi + slack
            )
    for limit, cosine in zip(machine.max_tilt, machine.tilt_map.enclose(x), strict=True):
        if limit < np.pi:
            inside &= cosine.mid[0] - cosine.rad[0] >= np.cos(limit * (1 + USE_ROUNDING))
    rows = np.flatnonzero(inside)
    if machine.bodies and len(rows):
        least = machine.bodies.distances(pose_rows(centre[rows], rotation)) - machine.bodies.contact
        reach = np.linalg.norm(half[rows], axis=1)
        inside[rows] = (least + USE_ROUNDING * machine.bodies.contact >= reach[:, None]).all(1)
    return inside


def prove(
    machine: Machine, rotation: Rotation, low: Array, high: Array, depth: int
) -> tuple[np.ndarray, np.ndarray, Array]:
    """Of the boxes low … high (N, 3): proved inside (N,) bool, found outside (N,) bool, and where
    (N, 3).

    The place is a position outside, or the centre of a cell that stays open when its box has been
    halved `depth` times.
    """
    centre, half = (low + high) / 2, (high - low) / 2 * (1 + 1e-12)  # covers the rounding of both
    owner = np.arange(len(low))
    outside, open_, place = np.zeros(len(low), bool), np.zeros(len(low), bool), centre.copy()
    signs = np.array(list(product((-0.5, 0.5), repeat=3)))
    for level in range(depth + 1):
        fail = ~prove_cells(machine, rotation, centre, half)
        owner, centre, half = owner[fail], centre[fail], half[fail]
        wrong = uses(machine, rotation, centre).max(1) > 1 + USE_ROUNDING
        outside[owner[wrong]], place[owner[wrong]] = True, centre[wrong]
        fail = ~outside[owner]
        owner, centre, half = owner[fail], centre[fail], half[fail]
        if not len(owner):
            break
        split = signs[(signs[:, ~half.any(0)] < 0).all(1)]  # what has no extent is not halved
        if level == depth or len(owner) * len(split) > MAX_CELLS:
            open_[owner], place[owner] = True, centre
            break
        owner = np.repeat(owner, len(split))
        shift = np.where(half.any(0), split, 0.0)
        centre = (centre[:, None] + shift * half[:, None]).reshape(-1, 3)
        half = np.repeat(np.where(half.any(0), 0.5, 1.0) * half, len(split), 0)
    return ~outside & ~open_, outside, place


def contains(
    machine: Machine, rotation: Rotation, low: ArrayLike, high: ArrayLike, depth: int = 9
) -> Containment:
    """Whether all positions of the box low … high (3,) m are inside all limits: proved, refuted by
    a place, or open.

    Inside means what it means to `Margins`: no more than USE_ROUNDING of a limit beyond it. Raises
    MotionError for ends that are none, OutOfReach where the machine does not control what the box
    asks.
    """
    what = f"box of machine {machine.name}:"
    low, high = (
        finite_array(end, f"{what} {name}", (3,), unit="m")
        for end, name in ((low, "low"), (high, "high"))
    )
    if (low > high).any():
        raise MotionError(
            f"{what} no coordinate of low {low.tolist()} may be above that of high {high.tolist()}"
        )
    refuse_uncontrolled(
        machine, pose_rows(np.stack([low, high]), rotation), ("low", "high").__getitem__
    )
    corners = np.array(list(product(*zip(low, high, strict=True))))
    use = uses(machine, rotation, corners).max(1)
    worst = int(np.argmax(use))
    if use[worst] > 1 + USE_ROUNDING:
        return Containment(
            False,
            freeze_array(corners[worst]),
            f"corner {describe_worst(machine, rotation, corners[worst])}",
        )
    proved, outside, places = prove(machine, rotation, low[None], high[None], depth)
    if proved[0]:
        return Containment(True, None, "every position of the box is inside all limits")
    place = places[0]
    where = describe_worst(machine, rotation, place)
    if outside[0]:
        return Containment(False, freeze_array(place), f"position {where}")
    return Containment(
        False,
        freeze_array(place),
        f"not proved near {where}; it may touch a limit: make the box smaller",
    )


def describe_worst(machine: Machine, rotation: Rotation, place: Array) -> str:
    """A position in mm, and what is worst there."""
    at = ", ".join(f"{1e3 * value:.6g}" for value in place)
    try:
        worst = machine.check(RigidTransform.from_components(place, rotation)).worst()
    except OutOfReach:
        worst = "out of reach"
    return f"({at}) mm: {worst}"
