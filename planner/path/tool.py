"""The tool: where it sits on the platform, and the platform's path that takes the tool along its own."""

from dataclasses import replace
from functools import cache, partial

import casadi as ca
import numpy as np

from kinematics.foundation.arrays import freeze_array
from kinematics.foundation.casadi_function import Expression
from kinematics.machine.pose import Pose, column, split_pose_symbols, to_numbers
from planner.path.shape import Piece, Shape


def carry_tool(piece: Piece, tool: Pose) -> Piece:
    """The platform's way P(s) = T(s) · tool⁻¹ under the tool's way T(s); path length stays the tool's own."""
    parameters = np.concatenate([piece.parameters, to_numbers(tool.inv())[0]])
    return replace(piece, shape=_carried_shape(piece.shape), parameters=freeze_array(parameters))


@cache
def _carried_shape(shape: Shape) -> Shape:
    """The tool's inverse is twelve more parameters, so that all tools share one expression."""
    return Shape(f"{shape.name}_by_tool", shape.size + 12, partial(_motion, shape))


def _motion(shape: Shape, s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    own, back = ca.vertsplit(parameters, [0, shape.size, shape.size + 12])
    position, rotation = shape.motion(s, own)
    offset, turn = split_pose_symbols(back)
    return position + rotation @ offset, rotation @ turn


def tool_map(tool: Pose) -> Expression:
    """The platform's twelve numbers -> the tool's, P · tool. It is linear, so it maps their derivatives too."""
    x, constant = ca.SX.sym("x", 12), ca.SX(to_numbers(tool)[0])
    (position, rotation), (offset, turn) = split_pose_symbols(x), split_pose_symbols(constant)
    return Expression("tool", x, column(position + rotation @ offset, rotation @ turn))
