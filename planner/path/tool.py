"""The tool: where it sits on the platform, and the platform's path that takes the tool along its own."""

from dataclasses import replace
from functools import cache, partial

import casadi as ca
import numpy as np

from kinematics.array import frozen
from kinematics.expression import Expression
from kinematics.pose import Pose, column, numbers, symbols
from planner.path.shape import Piece, Shape


def carrying(piece: Piece, tool: Pose) -> Piece:
    """The platform's way P(s) = T(s) · tool⁻¹ under the tool's way T(s); path length stays the tool's own."""
    parameters = np.concatenate([piece.parameters, numbers(tool.inv())[0]])
    return replace(piece, shape=_carrying(piece.shape), parameters=frozen(parameters))


@cache
def _carrying(shape: Shape) -> Shape:
    """The tool's inverse is twelve more parameters, so that all tools share one expression."""
    return Shape(f"{shape.name}_by_tool", shape.size + 12, partial(_motion, shape))


def _motion(shape: Shape, s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    own, back = ca.vertsplit(parameters, [0, shape.size, shape.size + 12])
    position, rotation = shape.motion(s, own)
    offset, turn = symbols(back)
    return position + rotation @ offset, rotation @ turn


def tool_map(tool: Pose) -> Expression:
    """The platform's twelve numbers -> the tool's, P · tool. It is linear, so it maps their derivatives too."""
    x, constant = ca.SX.sym("x", 12), ca.SX(numbers(tool)[0])
    (position, rotation), (offset, turn) = symbols(x), symbols(constant)
    return Expression("tool", x, column(position + rotation @ offset, rotation @ turn))
