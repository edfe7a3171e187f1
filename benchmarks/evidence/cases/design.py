"""Design calculations, worked: a stepper sized, actuators and joints selected.

The stepper is that of [Sasidhar 1981, Appendix B]. The parts are those of [Sahbaz 2007, Tables 3.1
and 3.4 to 3.6], for its initial design. The case `published` compares printed numbers with ours.
"""

from collections.abc import Iterator

from benchmarks.evidence.published.initial_design import PRINTED, needs
from benchmarks.evidence.published.stepper_sizing import size_axis
from benchmarks.evidence.table import quote
from kinematics.design.catalogue import load_actuators, load_joints
from kinematics.design.selection import select_parts


def measure() -> Iterator[str]:
    """Yield our sizing of the vertical axis, and the parts that fit."""
    actuator, joint = needs()
    actuators = load_actuators()
    yield quote("Our sizing of the vertical axis", size_axis())
    yield quote("Actuators for the printed stroke and force", select_parts(actuators, PRINTED))
    yield quote(
        "Actuators for the stroke and force that follow from the printed geometry",
        select_parts(actuators, actuator),
    )
    yield quote("Joints for the same", select_parts(load_joints(), joint))
