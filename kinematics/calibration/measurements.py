"""Measured poses: what was commanded, what was measured of it, and how well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation.arrays import Array, finite_array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.machine.pose import to_numbers

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz", "axis u", "axis v")
"""Errors of a pose: position and turn in the measuring frame; where only the platform's z axis is
known, its turn about the measured pose's own x and y.
"""
POSITION, ROTATION, AXIS = slice(0, 3), slice(3, 6), slice(6, 8)
MAX_HOME_DISTANCE = 1e3
"""m from home beyond which nothing is a measured pose of a machine, but a slip of units."""


LEAST_NOISE = 1e-15
"""m or rad: what is smaller is no noise but rounding, and the errors over it no numbers."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviation of one component of a measured position (m) and rotation (rad)."""

    position: float
    rotation: float

    def __post_init__(self) -> None:
        for what, value in (("position", self.position), ("rotation", self.rotation)):
            if (
                not LEAST_NOISE
                <= finite_array(value, f"measurements: noise of the {what}", ())
                <= MAX_HOME_DISTANCE
            ):
                raise MotionError(
                    f"measurements: noise of the {what} {value} must lie between {LEAST_NOISE:g} and "
                    f"{MAX_HOME_DISTANCE:g} (m or rad)"
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurements(Result):
    """N commanded and measured poses, relative to the machine's home pose (frame "home" of
    programs).

    seen    (N, 8) bool, by COMPONENTS: what was measured; of the rest `measured` holds anything
    fit     (N,) bool: what parameters are fitted to; the other poses are checks
    noise   None: not stated, so it is estimated from the residuals
    spread  (N, 8) m and rad, largest deviation of repetitions from their mean; NaN: not stated
    notes   what the file leaves open, and what was taken for it
    lines   of the file, for messages: where each pose stands in it; empty: of no file
    machine  name of the machine that was measured; "": not stated
    """

    commanded: Pose = field(repr=False)
    measured: Pose = field(repr=False)
    seen: np.ndarray = field(repr=False)
    labels: tuple[str, ...]
    fit: np.ndarray
    spread: Array = field(repr=False)
    noise: Noise | None = None
    name: str = "measurements"
    notes: tuple[str, ...] = ()
    lines: tuple[int | None, ...] = ()
    machine: str = ""

    def __post_init__(self) -> None:
        for pose, what in ((self.commanded, "commanded"), (self.measured, "measured")):
            self._check(pose, what)
        if self.noise is not None and not isinstance(self.noise, Noise):
            raise MotionError(f"{self.name}: noise must be a Noise or None, not {self.noise!r}")
        shapes = {"seen": (self.seen, (len(self), 8)), "fit": (self.fit, (len(self),))}
        for what, (array, shape) in {**shapes, "spread": (self.spread, (len(self), 8))}.items():
            if np.shape(array) != shape:
                raise MotionError(
                    f"{self.name}: {what} must have shape {shape}, not {np.shape(array)}"
                )

    def _check(self, pose: Pose, what: str) -> None:
        from scipy.spatial.transform import RigidTransform

        if not isinstance(pose, RigidTransform):
            raise MotionError(
                f"{self.name}: {what} must be poses (RigidTransform), not {type(pose).__name__}"
            )
        if pose.single:
            raise MotionError(
                f"{self.name}: {what} is a single pose; give a batch, of one pose or more"
            )
        if len(pose) != len(self.labels):
            raise MotionError(
                f"{self.name}: {len(pose)} {what} poses for {count_noun(len(self.labels), 'label')}; give one each"
            )
        bad = ~(
            np.isfinite(to_numbers(pose)).all(1)
            & (np.abs(pose.translation) <= MAX_HOME_DISTANCE).all(1)
        )
        if bad.any():
            label = self.labels[int(np.argmax(bad))]
            raise MotionError(
                f"{self.name}: {label}: {what} must be finite, and within {MAX_HOME_DISTANCE:g} m of home"
            )

    def __len__(self) -> int:
        return len(self.labels)

    def tables(self) -> tuple[Table, ...]:
        """Each pose as it was commanded and measured, as far as it was; what is fitted to."""
        columns = [Column("pose", self.labels)]
        for what, pose in (("commanded", self.commanded), ("measured", self.measured)):
            values = np.column_stack(
                [pose.translation, pose.rotation.as_euler("XYZ", suppress_warnings=True)]
            )
            known = self.seen[:, :6] if what == "measured" else np.ones_like(self.seen[:, :6])
            for k, name in enumerate(COMPONENTS[:6]):
                shown = [
                    value if there else None
                    for value, there in zip(
                        values[:, k].tolist(), known[:, k].tolist(), strict=True
                    )
                ]
                if any(value is not None for value in shown):
                    columns.append(
                        Column(f"{what} {name}", shown, "m" if k < 3 else "rad", "human", ".4f")
                    )
        columns.append(Column("fitted", self.fit))
        return (
            Table(
                f"{self.name}: {count_noun(len(self), 'pose')} from home",
                tuple(columns),
                self.notes,
            ),
        )


def whole_poses(
    commanded: Pose,
    measured: Pose,
    *,
    noise: Noise | None = None,
    labels: Sequence[str] | None = None,
    name: str = "measurements",
) -> Measurements:
    """Measurements of whole poses.

    Parameters
    ----------
    commanded, measured
        Batches of N poses, relative to the machine's home pose.
    noise
        Standard deviations of the measurements; None: unknown, so residuals give the scale.
    labels
        What messages call each pose. None: counted from 1.
    name
        What messages call the measurements.

    Returns
    -------
    Measurements
        All of them used in a fit.

    Raises
    ------
    MotionError
        The poses are no batches of the same length, not finite, or not one for each label.
    """
    return _build_measurements(commanded, measured, ROTATION.stop, noise, labels, name)


def measured_positions(
    commanded: Pose,
    measured: ArrayLike,
    *,
    noise: Noise | None = None,
    labels: Sequence[str] | None = None,
    name: str = "measurements",
) -> Measurements:
    """Measurements of positions without rotations.

    Parameters
    ----------
    commanded
        Batch of N poses, relative to the machine's home pose.
    measured
        (N, 3) m in the home frame.
    noise, labels, name
        As of `whole_poses`.

    Returns
    -------
    Measurements
        All of them used in a fit.

    Raises
    ------
    MotionError
        As `whole_poses`.
    """
    from scipy.spatial.transform import RigidTransform

    places = finite_array(measured, f"{name}: measured", unit="m")
    if places.ndim != 2 or places.shape[1] != 3:
        raise MotionError(
            f"{name}: measured must be positions (N, 3) in m, not of shape {places.shape}"
        )
    return _build_measurements(
        commanded, RigidTransform.from_translation(places), POSITION.stop, noise, labels, name
    )


def _build_measurements(
    commanded: Pose,
    measured: Pose,
    seen: int,
    noise: Noise | None,
    labels: Sequence[str] | None,
    name: str,
) -> Measurements:
    from scipy.spatial.transform import RigidTransform

    count = len(commanded) if isinstance(commanded, RigidTransform) and not commanded.single else 1
    named = tuple(labels) if labels is not None else tuple(f"pose {k + 1}" for k in range(count))
    return Measurements(
        commanded=commanded,
        measured=measured,
        seen=freeze_array(np.broadcast_to(np.arange(8) < seen, (len(named), 8)), bool),
        labels=named,
        fit=freeze_array(np.ones(len(named)), bool),
        spread=freeze_array(np.full((len(named), 8), np.nan)),
        noise=noise,
        name=name,
    )


def select_rows(data: Measurements, rows: Sequence[int]) -> Measurements:
    """Some of the measurements."""
    chosen = np.array(rows, int)
    return replace(
        data,
        commanded=data.commanded[chosen],
        measured=data.measured[chosen],
        seen=data.seen[chosen],
        fit=data.fit[chosen],
        spread=data.spread[chosen],
        labels=tuple(data.labels[k] for k in chosen),
        lines=tuple(data.lines[k] for k in chosen) if data.lines else (),
    )
