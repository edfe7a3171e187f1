"""The tables of what a machine moves, written: gravity, [platform], [legs]."""

from collections.abc import Iterator

from kinematics.body import Body
from kinematics.errors import MotionError
from kinematics.load import GRAVITY, Load
from kinematics.toml_text import millimetres, plain, quantity, vector


def gravity(load: Load, complete: bool = False) -> Iterator[str]:
    if complete or tuple(load.gravity) != GRAVITY:
        yield f"gravity = {vector(load.gravity, 'm/s^2')}"


def load(machine: str, stated: Load) -> Iterator[str]:
    """As far as the machine states any. Raises MotionError for legs that differ."""
    if stated.platform.mass > 0 or stated.wrench.any():
        yield from ("", "[platform]", *(f"{key} = {text}" for key, text in _body(stated.platform)))
        yield f"force = {vector(stated.wrench[:3], 'N')}"
        yield f"moment = {vector(stated.wrench[3:], 'N*m')}"
    if len(stated.legs) > 1:
        raise MotionError(f"machine {machine}: legs of different masses have no place in a machine file")
    for leg in stated.legs:
        yield from ("", "[legs]")
        for name, body in (("barrel", leg.barrel), ("rod", leg.rod)):
            yield f"{name} = {{ {', '.join(f'{key} = {text}' for key, text in _body(body))} }}"
        if leg.first_axis is not None:
            yield f"first_axis = {plain(leg.first_axis)}"


def _body(body: Body) -> Iterator[tuple[str, str]]:
    yield "mass", quantity(body.mass, "kg")
    yield "centre", millimetres(body.centre)
    yield "inertia", f"[{', '.join(vector(row, 'kg*m^2') for row in body.inertia)}]"
