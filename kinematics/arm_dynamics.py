"""Torques of a serial arm's links, by the recursive Newton-Euler algorithm."""

from typing import Any

import numpy as np

from kinematics.arm import Arm
from kinematics.array import Array
from kinematics.body import Body
from kinematics.motion import Motion
from kinematics.pinocchio_adapter import inertia, pinocchio


def arm_model(arm: Arm, gravity: Array) -> Any:
    """pinocchio's model of the joints and their links: every joint's frame is parallel to the base's at q = 0."""
    pin = pinocchio("the dynamics of an arm")
    model, on, parent = pin.Model(), np.zeros(3), 0
    model.gravity.linear[:] = gravity
    links = arm.joints.links or ((0.0, np.zeros(3), np.zeros((3, 3))),) * 3
    for axis, point, direction, link in zip(arm.axes, arm.joints.points, arm.joints.directions, links, strict=True):
        placement = pin.SE3(np.eye(3), point - on)
        parent = model.addJoint(parent, pin.JointModelRevoluteUnaligned(direction), placement, axis.name)
        body = Body(*link, name=f"machine {arm.name}: what {axis.name} moves")
        model.appendBodyToJoint(parent, inertia(body), pin.SE3(np.eye(3), -point))
        on = point
    return model


def link_torques(arm: Arm, motion: Motion, gravity: Array) -> Array:
    """(N, 3) N·m: τ = M(q) q̈ + C(q, q̇) q̇ + g(q) of the links alone."""
    pin, model = pinocchio("the dynamics of an arm"), arm_model(arm, gravity)
    data = model.createData()
    rows = zip(motion.q, motion.qd, motion.qdd, strict=True)
    return np.array([pin.rnea(model, data, q, qd, qdd) for q, qd, qdd in rows])
