"""The [geometry] tables of machine files, written: one function for each kind."""

from collections.abc import Callable, Iterator
from math import pi
from typing import Any

import numpy as np

from kinematics.clearance import Disc
from kinematics.errors import MotionError
from kinematics.hexapod import Hexapod
from kinematics.legs import Legged
from kinematics.linkage import Linkage
from kinematics.machine import Machine
from kinematics.pose import Pose
from kinematics.toml_text import millimetres, plain, quantity, rows
from kinematics.traverser import Traverser
from kinematics.tripod import Tripod


def geometry(machine: Machine, complete: bool = False) -> tuple[str, Iterator[str]]:
    """The kind of a machine, and the lines of its geometry; complete: with what holds where nothing is said.

    Raises MotionError for what a file cannot say.
    """
    for made, (kind, lines) in _KINDS.items():
        if isinstance(machine, made):
            return kind, lines(machine, complete)
    kinds = ", ".join(kind for kind, _ in _KINDS.values())
    raise MotionError(f"machine {machine.name}: a {type(machine).__name__} is not written; these kinds are: {kinds}")


def _hexapod(machine: Hexapod, complete: bool) -> Iterator[str]:
    yield from _legged(machine, np.zeros(3), complete)


def _tripod(machine: Tripod, complete: bool) -> Iterator[str]:
    yield from _legged(machine, machine.tool, complete)
    if complete or machine.tool.any():
        yield f"tool = {millimetres(machine.tool)}"


def _legged(machine: Legged, tool: np.ndarray, complete: bool) -> Iterator[str]:
    """tool (3,): where the machine's own platform frame lies in the file's."""
    for key, points in (("base_joints", machine.base), ("platform_joints", machine.platform + tool)):
        yield f"{key} = {rows(millimetres(point) for point in points)}"
    yield _home(machine.home)
    for key, rests in (("base_rest", machine.base_rest), ("platform_rest", machine.platform_rest)):
        if complete or (rests != [0.0, 0.0, 1.0]).any():
            yield f"{key} = {rows(plain(rest) for rest in rests)}"
    if (machine.max_tilt < pi).any():
        first, last = (quantity(machine.max_tilt[k], "rad") for k in (0, -1))
        yield f"max_tilt = [{first}, {last}]"
    if machine.bodies is not None:
        bodies = machine.bodies
        yield f"leg_radius = {quantity(bodies.leg_radius, 'mm', 3)}"
        if bodies.leg_ends is not None:
            yield f"leg_ends = {quantity(bodies.leg_ends, 'mm', 3)}"
        if bodies.base_disc is not None:
            yield f"base_disc = {_disc(bodies.base_disc, np.zeros(3))}"
        if bodies.platform_disc is not None:
            yield f"platform_disc = {_disc(bodies.platform_disc, tool)}"


def _linkage(machine: Linkage, complete: bool) -> Iterator[str]:
    yield f"base_a = {millimetres(machine.base_a)}"
    yield f"base_b = {millimetres(machine.base_b)}"
    yield f"offset = {quantity(machine.offset, 'mm', 3)}"
    yield f"angle = {quantity(machine.angle, 'rad')}"
    yield _home(machine.home)
    if complete or machine.home_q[0] < machine.offset * np.cos(machine.angle):  # else the longer one is meant
        yield f"near = {millimetres(machine.home_q)}"


def _traverser(machine: Traverser, complete: bool) -> Iterator[str]:
    yield _home(machine.home)
    if complete or (machine.directions != np.eye(3)).any():
        yield f"directions = {rows(plain(direction) for direction in machine.directions)}"
    yield f"length = {quantity(machine.characteristic_length, 'mm', 3)}"


def _home(home: Pose) -> str:
    angles = (quantity(angle, "rad") for angle in home.rotation.as_euler("XYZ") + 0.0)
    return f"home = {{ to = {millimetres(home.translation)}, rotate = [{', '.join(angles)}] }}"


def _disc(disc: Disc, tool: np.ndarray) -> str:
    return (
        f"{{ radius = {quantity(disc.radius, 'mm', 3)}, thickness = {quantity(disc.thickness, 'mm', 3)}, "
        f"centre = {millimetres(np.asarray(disc.centre, float) + tool)}, normal = {plain(disc.normal)} }}"
    )


_KINDS: dict[type[Machine], tuple[str, Callable[[Any, bool], Iterator[str]]]] = {
    Hexapod: ("hexapod", _hexapod),
    Tripod: ("tripod", _tripod),
    Linkage: ("linkage", _linkage),
    Traverser: ("traverser", _traverser),
}
"""An arm's geometry is its URDF, which stays as it is: only the axes of its file could change."""
