"""Margins: how much of each limit a pose uses, what comes nearest to what, and how far the machine
is from singular.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kinematics.analysis.clearance import clearance_use
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.machine.model import MachineModel, scaled_jacobian

if TYPE_CHECKING:
    pass

# Rounding of a stroke computed from coordinates of decimetres; far below any pulse.
USE_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Margins(Result):
    """Use of each limit at each pose: 1 is at the limit, above 1 violates it.

    travel        (N, n) |q − middle| / half range, per axis; 0 where there is no limit
    tilt          (N, m) angle / limit, per joint; of π where there is no limit, which counts as no
                  use. The joints of a leg of no length, which has no direction, count as turned
                  over
    clearance     (N, k) m between the surfaces of legs, and of legs and discs; below 0 they
                  overlap. Its use is contact / distance, both between axes (or axis and disc)
    room          (N, r) |x − middle| / half range, of each coordinate of the platform's origin that
                  the room bounds
    conditioning  (N,) σ_min/σ_max of the Jacobian of what the machine controls, the columns of its
                  rotations divided by the machine's characteristic length: 1 at best, 0 in a
                  singularity
    singularity   (N,) σ_min of the same: the distance (2-norm) to the nearest singular Jacobian. No
                  motion whose speed, taken with the characteristic length, is 1 m/s moves the axes
                  slower. 0 too where the Jacobian has no finite entries: an arm stretched out, a
                  leg of no length
    """

    travel: Array
    tilt: Array
    max_tilt: Array
    """(m,) rad, what `tilt` is a share of; π where there is no limit."""
    clearance: Array
    contact: Array
    """(k,) m between the axes of what `clearance` names when they touch."""
    conditioning: Array
    singularity: Array
    room: Array
    characteristic_length: float
    """m that count as one radian in `conditioning` and `singularity`."""
    travel_names: tuple[str, ...]
    tilt_names: tuple[str, ...]
    clearance_names: tuple[str, ...]
    room_names: tuple[str, ...]

    @property
    def ok(self) -> np.ndarray:
        """(N,) bool: every limit respected. No limit is set on conditioning and singularity."""
        return np.asarray(self.uses.max(1) <= 1 + USE_ROUNDING)

    @property
    def use(self) -> Array:
        """(N,) of the limit that is used most."""
        return freeze_array(self.uses.max(1))

    def worst(self) -> str:
        """Name and use of the limit that is used most, over all poses."""
        use = self.uses
        if not use.size:
            raise MotionError("margins of no poses have no worst case; check at least one pose")
        pose, entry = np.unravel_index(int(np.argmax(use)), use.shape)
        names = [f"{name} travel" for name in self.travel_names] + [
            f"{name} tilt" for name in self.tilt_names
        ]
        at = f" at pose {pose}" if len(use) > 1 else ""
        if entry < len(names):
            return f"{names[entry]}: {use[pose, entry]:.1%} of its limit{at}"
        pair = int(entry) - len(names)
        if pair >= len(self.clearance_names):
            return f"{self.room_names[pair - len(self.clearance_names)]} room: {use[pose, entry]:.1%} of its limit{at}"
        return (
            f"{self.clearance_names[pair]} clearance: {self.clearance[pose, pair] * 1e3:.3g} mm{at}"
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Of every limit: of each axis' travel, of each joint's tilt, of each clearance, of the
        room.
        """
        kinds = (
            (self.travel_names, "travel"),
            (self.tilt_names, "tilt"),
            (self.clearance_names, "clearance"),
        )
        return tuple(
            f"{name} {kind}"
            for names, kind in (*kinds, (self.room_names, "room"))
            for name in names
        )

    def tables(self) -> tuple[Table, ...]:
        """Pose by pose: what is used most, clearance, conditioning, distance to singular, and
        whether all is well.
        """
        use = self.uses
        least = self.clearance.min(1, initial=np.inf)
        columns = (
            Column("pose", range(len(use))),
            Column("use", use.max(1, initial=0.0), form=".4f"),
            Column("of", [self.names[k] for k in use.argmax(1)] if use.size else [""] * len(use)),
            *(
                [Column("least clearance", least, "m", "human", ".3f")]
                if self.clearance_names
                else []
            ),
            Column("conditioning", self.conditioning, form=".4g"),
            Column("singularity", self.singularity, form=".4g"),
            Column("ok", self.ok, words={"False": "NO"}),
        )
        return (Table("use of the limits; 1 is at the limit", columns),)

    def data(self) -> Table:
        """The use of every limit, pose by pose."""
        uses = self.uses
        each = (Column(name, uses[:, k]) for k, name in enumerate(self.names))
        rest = (Column("conditioning", self.conditioning), Column("singularity", self.singularity))
        return Table(
            "use of the limits",
            (Column("pose", range(len(uses))), *each, *rest, Column("ok", self.ok)),
        )

    @property
    def uses(self) -> Array:
        """(N, limits) of every limit of `names`; 1 is at the limit."""
        limited = np.where(self.max_tilt < np.pi, self.tilt, 0.0)
        return np.concatenate(
            [self.travel, limited, clearance_use(self.clearance, self.contact), self.room], 1
        )


def measure(machine: MachineModel, x: Array, q: Array) -> Margins:
    """Return the margins of pose numbers (N, 12) and the coordinates (N, n) that belong to them."""
    travel, tilt, clearance, room = limits_used(machine, x, q)
    bounded = np.isfinite(np.array(machine.room, float)).all(1)
    stretch = _singular_values(scaled_jacobian(machine, x, q))
    return Margins(
        travel=freeze_array(travel),
        tilt=freeze_array(tilt),
        max_tilt=machine.max_tilt,
        clearance=freeze_array(clearance),
        contact=freeze_array(machine.bodies.contact if machine.bodies else []),
        conditioning=freeze_array(stretch[:, -1] / np.where(stretch[:, 0] > 0, stretch[:, 0], 1.0)),
        singularity=freeze_array(stretch[:, -1]),
        room=freeze_array(room[:, bounded]),
        characteristic_length=machine.characteristic_length,
        travel_names=tuple(axis.name for axis in machine.axes),
        tilt_names=machine.tilt_names,
        clearance_names=machine.bodies.names if machine.bodies else (),
        room_names=tuple(name for name, wall in zip("xyz", bounded, strict=True) if wall),
    )


def limits_used(machine: MachineModel, x: Array, q: Array) -> tuple[Array, Array, Array, Array]:
    """travel (N, n), tilt (N, m), clearance (N, k) and room (N, 3) of pose numbers x and their
    coordinates q.

    As in `Margins`; of a coordinate that the room leaves free 0.
    """
    # a leg of no length has no direction
    cosine = np.nan_to_num(machine.tilt_map(x), nan=-1.0)
    tilt = np.arccos(np.clip(cosine, -1.0, 1.0)) / machine.max_tilt
    bodies = machine.bodies
    clearance = bodies.distances(x) - bodies.contact if bodies else np.zeros((len(x), 0))
    return (
        travel_use(machine, q),
        tilt,
        clearance,
        _range_use(x[:, :3], np.array(machine.room, float)),
    )


def travel_use(machine: MachineModel, q: Array) -> Array:
    """(N, n) |q − middle| / half range of coordinates (N, n); 0 where the travel has no ends."""
    return _range_use(q - machine.home_q, np.array([axis.travel for axis in machine.axes]))


def _range_use(values: Array, ranges: Array) -> Array:
    lo, hi = ranges.T
    with np.errstate(invalid="ignore"):  # no ends: ∞ / ∞
        use = np.abs(values - (lo + hi) / 2) / ((hi - lo) / 2)
    return np.where(np.isinf(hi), 0.0, use)


def _singular_values(jacobian: Array) -> Array:
    """(N, n), falling; 0 where the Jacobian is not finite."""
    finite = np.isfinite(jacobian).all((1, 2), keepdims=True)
    return np.asarray(np.linalg.svd(np.where(finite, jacobian, 0.0), compute_uv=False))
