"""What a machine is to its users: its maps, and what is computed with them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.machine.axis import Axis, Magnitude, directional_bounds
from kinematics.machine.model import MachineModel
from kinematics.machine.pose import PoseLike

if TYPE_CHECKING:
    from kinematics.analysis.forward import Forward
    from kinematics.analysis.margins import Margins
    from kinematics.analysis.virtual_work import Balance
    from kinematics.machine.pose import Pose

UNLIMITED = {"inf": "unlimited", "-inf": "unlimited", "None": "unlimited"}


def axes_table(machine: Machine) -> Table:
    """Travel, pulse and limits of each axis; both ways, towards smaller positions first, where they
    differ on one.
    """
    axes, units = machine.axes, [axis.unit for axis in machine.axes]
    forces = ["N" if axis.kind == "linear" else "N m" for axis in axes]
    columns = [
        Column("axis", [axis.name for axis in axes]),
        Column("travel from", [axis.travel[0] for axis in axes], units, "human", words=UNLIMITED),
        Column("to", [axis.travel[1] for axis in axes], units, "human", words=UNLIMITED),
        Column("pulse", [axis.pulse for axis in axes], units, "micro"),
    ]
    limits: tuple[tuple[str, Callable[[Axis], Magnitude | None], str], ...] = (
        ("speed", lambda axis: axis.max_speed, "/s"),
        ("acceleration", lambda axis: axis.max_acceleration, "/s^2"),
        ("jerk", lambda axis: axis.max_jerk, "/s^3"),
    )
    for name, bound, per in limits:
        below, above = zip(*(directional_bounds(bound(axis)) for axis in axes), strict=True)
        ways = {name: above} if below == above else {f"{name} down": below, f"{name} up": above}
        columns += [
            Column(way, values, [f"{unit}{per}" for unit in units], "human", words=UNLIMITED)
            for way, values in ways.items()
        ]
    if any(axis.max_force is not None for axis in axes):
        columns.append(Column("force", [axis.max_force for axis in axes], forces, words=UNLIMITED))
    if any(axis.max_pulse_rate is not None for axis in axes):
        columns.append(
            Column("pulse rate", [axis.max_pulse_rate for axis in axes], "1/s", words=UNLIMITED)
        )
    title = f"{machine.name}: {type(machine).__name__.lower()}, moves {' '.join(machine.freedom)}"
    return Table(title, tuple(columns))


class Machine(MachineModel, Result):
    """A machine with n axes that moves a platform (or tool).

    Its kind states the inverse map once; all else here follows from that: see
    `kinematics.machine.kind`.
    """

    @property
    def force_map(self) -> Balance:
        """x, ẋ, ẍ (12 each), q, q̇, q̈ (n each) -> actuator forces (n): see
        `kinematics.analysis.virtual_work`.
        """
        from kinematics.analysis.virtual_work import force_map

        return self.derive(force_map, of_load=True)

    @property
    def force_terms_map(self) -> Balance:
        """x, x′, x″, q, q′, q″ along a path -> forces (3 n): at rest, for s̈ = 1 from rest, and for
        ṡ = 1.
        """
        from kinematics.analysis.virtual_work import force_terms_map

        return self.derive(force_terms_map, of_load=True)

    @property
    def holding_map(self) -> Balance:
        """x (12), q (n) -> the forces (n) that hold the machine still."""
        from kinematics.analysis.virtual_work import holding_map

        return self.derive(holding_map, of_load=True)

    @property
    def loaded(self) -> bool:
        """Whether it states masses, friction or a wrench: without any, its actuators have nothing
        to push.
        """
        from kinematics.analysis.virtual_work import has_load

        return self.derive(has_load, of_load=True)

    def forward(self, q: ArrayLike, near: Pose | None = None, *, certify: bool = True) -> Forward:
        """Find the pose of actuator coordinates, by Newton on SE(3).

        Parameters
        ----------
        q
            (N, n) or (n,), m or rad.
        near
            The pose from which it is looked for, or one for each row. None: home.
        certify
            False leaves the proof out, which takes most of the time: nothing is certified then.

        Returns
        -------
        Forward
            Pose, residual, and whether it is proved to be connected with `near`.

        Raises
        ------
        MotionError
            They are no coordinates.
        OutOfReach
            No pose is found that has the lengths q (n,); among several, their `residual` tells.
        """
        from kinematics.analysis.forward import solve

        if near is not None:
            from kinematics.machine.pose import Pose

            # numbers could as well be the coordinates that inverse takes as its near
            if not isinstance(near, Pose):
                raise MotionError(
                    f"machine {self.name}: near must be a pose: a scipy RigidTransform, not {near!r:.80}; "
                    "RigidTransform.from_components(position, rotation) makes one"
                )
        return solve(self, q, near, certify)

    def check(self, pose: PoseLike, near: ArrayLike | None = None) -> Margins:
        """Measure travel, tilt and clearance against their limits, conditioning, and how near a
        singularity is.

        Parameters
        ----------
        pose
            One or N in the base frame, as of `inverse`.
        near
            (n,) as in `inverse`: which of a pose's coordinates are meant, where there are several.

        Returns
        -------
        Margins
            Use of each limit at each pose.
        """
        from kinematics.analysis.margins import measure

        return measure(self, *self.locate_pose(self.read_pose(pose), near))

    def tables(self) -> tuple[Table, ...]:
        """Its axes and their limits; what its input shapers leave of vibrations, if it has any."""
        from kinematics.analysis.residual_vibration import find_residuals, tabulate_residuals

        left = find_residuals(self.axes)
        return (axes_table(self), *([tabulate_residuals(left)] if left else []))

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}: {count_noun(len(self.axes), 'axis')}>"
