"""The plate's rotation on three arms, as the program of [KMITL 2005] shows it: which arm lengths a
turned pose takes.

A machine of three arms keeps its plate's orientation and cannot turn it; the source turns it on the
screen alone. So does this: lengths are shown, and no motion is made of them.
"""

from dataclasses import dataclass, field

import numpy as np

from kinematics.foundation.arrays import Array, freeze_fields
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.kinds.tripod import Tripod
from kinematics.machine.machine_file import MachineSource, load_machine
from kinematics.machine.pose import join_pose
from planner.sources.position_list import PositionList
from planner.sources.positions import step_poses

ANGLE_TOLERANCE = 1e-9
"""rad by which a plate is held as it is at home, but for rounding."""
LENGTH_TOLERANCE = 1e-9
"""m by which arms may miss their lengths where the held plate is looked for."""


@dataclass(frozen=True, slots=True, eq=False)
class ArmSimulation(Result):
    """Arm lengths at N poses of the end point, turned ones too.

    listed   the poses, in their own frame
    lengths  (N, 3) m, between the joints of each arm
    stroke   (N, 3) m, from their lengths at home
    within   (N, 3) bool, whether that is in the arm's travel
    turned   (N,) bool: simulated only, for the machine keeps the orientation that its plate has at
             home
    off      (N,) m, by which the end point of the machine, its plate held, would miss the pose with
             these lengths; nan where no pose has them. 0 where the pose is not turned
    """

    machine: str
    listed: PositionList
    lengths: Array
    stroke: Array
    within: np.ndarray
    turned: np.ndarray
    off: Array
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        freeze_fields(self, "lengths", "stroke", "within", "turned", "off")

    def tables(self) -> tuple[Table, ...]:
        """Pose by pose: the arms' lengths, and what the machine can make of them."""
        short = [" ".join(str(k + 1) for k in np.flatnonzero(~row)) for row in self.within]
        columns = (
            Column("pose", range(1, len(self.listed) + 1)),
            *(Column(name, self.listed.poses[:, k], "m", "human") for k, name in enumerate("xyz")),
            *(
                Column(f"θ{name}", self.listed.poses[:, 3 + k], "rad", "human")
                for k, name in enumerate("xyz")
            ),
            *(Column(f"arm{k + 1}", self.lengths[:, k], "m", "human", ".3f") for k in range(3)),
            Column("plate", np.where(self.turned, "turned", "held").tolist()),
            Column("off", self.off, "m", "human", ".3f"),
            *((Column("beyond", short),) if any(short) else ()),
        )
        count = int(self.turned.sum())
        told = (
            f"rotated, and only simulated: {count} of {count_noun(len(self.listed), 'pose')}; no motion includes them",
            f"off: error of the end point if {self.machine}, whose plate cannot rotate, were driven to these lengths",
        )
        beyond = ("beyond: arms outside their travel",)
        title = f"arm lengths of {self.machine} at {count_noun(len(self.listed), 'pose')} from {self.listed.frame}"
        return (
            Table(
                title,
                columns,
                (*self.notes, *(told if count else ()), *(beyond if any(short) else ())),
            ),
        )


@check_arguments("machine")
def simulate_arms(
    listed: PositionList, machine: MachineSource, *, unit: float | None = None
) -> ArmSimulation:
    """Arm lengths at the poses of a list; rotation R = Ry · Rz · Rx if the list states so.

    Parameters
    ----------
    listed
        The poses.
    machine
        A machine with three arms, its name, or the path of its file.
    unit
        m: simulate every step of the source's rule (`positions.step_poses`), of a unit or of 1°.
        None: the listed
        poses.

    Returns
    -------
    ArmSimulation
        Lengths of the arms at each pose.

    Raises
    ------
    MotionError
        The machine has no three arms, or the list has no pose.
    """
    machine = load_machine(machine)
    if not isinstance(machine, Tripod):
        raise MotionError(
            f"arm simulation: machine {machine.name} is not a tripod; the simulation is for three arms"
        )
    if not len(listed):
        raise MotionError("arm simulation: the list has no pose; record one first")
    notes: list[str] = []
    if unit is not None:
        listed, notes = step_poses(listed, unit)
    pose = join_pose(listed.poses[:, :3], listed.rotations)
    if listed.frame == "home":
        pose = machine.home * pose
    lengths = machine.arm_lengths(pose)
    stroke = lengths - machine.home_q
    low, high = np.array([axis.travel for axis in machine.axes]).T
    turned = np.asarray((machine.home.rotation.inv() * pose.rotation).magnitude() > ANGLE_TOLERANCE)
    off = np.zeros(len(lengths))
    if turned.any():
        off[turned] = _position_error(machine, lengths[turned], pose.translation[turned])
    within = (stroke >= low - LENGTH_TOLERANCE) & (stroke <= high + LENGTH_TOLERANCE)
    return ArmSimulation(machine.name, listed, lengths, stroke, within, turned, off, tuple(notes))


def _position_error(machine: Tripod, lengths: Array, wanted: Array) -> Array:
    """(K,) m between places and those of the end point with the plate held; nan where no pose has
    the lengths.
    """
    from scipy.spatial.transform import Rotation

    home = machine.home.rotation.as_matrix()
    near = join_pose(wanted, Rotation.from_matrix([home] * len(wanted)))
    found = machine.forward(lengths, near=near, certify=False)
    gap = np.linalg.norm(found.pose.translation - wanted, axis=1)
    return np.where(found.residual <= LENGTH_TOLERANCE, gap, np.nan)
