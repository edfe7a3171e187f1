"""Design calculations, worked: a stepper sized, parts selected, and the error budget of a frame that bends.

The stepper and the frame are those of [Sasidhar 1981, Appendices B and D]. The parts are those of
[Sahbaz 2007, Tables 3.1 and 3.4 to 3.6], for its initial design. The case `published` compares
printed numbers with ours.
"""

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import RigidTransform

from benchmarks.evidence.published.deflections import FRAME, INCH, LOAD, POUND_FORCE
from benchmarks.evidence.published.initial_design import PRINTED, needs
from benchmarks.evidence.published.stepper_sizing import size_axis
from benchmarks.evidence.table import quote
from kinematics.design.accuracy import Budget, LeadError, Quantization, error_budget
from kinematics.design.catalogue import load_actuators, load_joints
from kinematics.design.deflection import Deflection
from kinematics.design.selection import select_parts
from kinematics.kinds.traverser import Traverser
from kinematics.machine.axis import Axis


def measure() -> Iterator[str]:
    """Yield our sizing of the vertical axis, the parts that fit, and the budget."""
    actuator, joint = needs()
    actuators = load_actuators()
    yield quote("Our sizing of the vertical axis", size_axis())
    yield quote("Actuators for the printed stroke and force", select_parts(actuators, PRINTED))
    yield quote(
        "Actuators for the stroke and force that follow from the printed geometry",
        select_parts(actuators, actuator),
    )
    yield quote("Joints for the same", select_parts(load_joints(), joint))
    yield quote("Errors of the traverser on its frame", budget_traverser())


def budget_traverser() -> Budget:
    """Return the budget along one span of 21 in. The traverser is at the top of X, 70 in above the frame."""
    axes = [Axis(name, pulse=0.000625 * INCH) for name in "XYZ"]
    axes.append(Axis("R", "rotary", pulse=np.deg2rad(0.9)))
    machine = Traverser(axes=axes, home=RigidTransform.identity())
    z = np.linspace(0, FRAME.span, 85)
    pose = RigidTransform.from_translation([(48 * INCH, 0, height) for height in z])
    start = (-22 * INCH, 0, 0)
    frame = Deflection(FRAME, LOAD * POUND_FORCE, start, along=(0, 0, 1), down=(-1, 0, 0))
    lead = LeadError(rate=(1e-3, 1e-3, 1e-3, 0.0))
    return error_budget(machine, pose, [Quantization(), lead, frame])
