"""Which of a pose's six components a machine controls, and the refusal of poses that need another."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from kinematics.array import Array
from kinematics.errors import NotFree
from kinematics.pose import numbers

if TYPE_CHECKING:
    from kinematics.machine import Machine

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")
# m or rad off home up to which a held component counts as kept: the rounding of poses put together from rotations.
HELD = 1e-9


def columns(machine: Machine) -> np.ndarray:
    """Indices of the components that the machine controls: the columns of its Jacobian that count."""
    return np.array([COMPONENTS.index(name) for name in machine.freedom])


def square_jacobian(machine: Machine, x: Array, near: Array) -> Array:
    """(N, n, n) of pose numbers x (N, 12): the columns that the machine controls."""
    full = machine.jacobian_map(machine.inputs(x, near)).reshape(len(x), len(machine.axes), 6)
    return full[:, :, columns(machine)]


def scaled_jacobian(machine: Machine, x: Array, near: Array) -> Array:
    """(N, n, n) the same with every column in axis units per metre: turns count at the characteristic length."""
    scale = np.where(columns(machine) < 3, 1.0, 1.0 / machine.characteristic_length)
    return square_jacobian(machine, x, near) * scale


def deviations(machine: Machine, x: Array) -> Array:
    """(N, 6) of pose numbers x (N, 12) from home: position, and the vector of the turn, in the base frame."""
    home = numbers(machine.home)
    turn = x[:, 3:].reshape(-1, 3, 3) @ home[0, 3:].reshape(3, 3).T
    return np.concatenate([x[:, :3] - home[:, :3], Rotation.from_matrix(turn).as_rotvec()], 1)


def refuse(machine: Machine, x: Array, name_of: Callable[[int], str] = "pose {}".format) -> None:
    """Raise NotFree, naming the component, for the first of N poses that leaves the machine's freedom."""
    held = [k for k, name in enumerate(COMPONENTS) if name not in machine.freedom + machine.follows]
    if not held or not len(x):
        return
    off = deviations(machine, x)[:, held]
    wrong = np.abs(off) > HELD
    if wrong.any():
        pose = int(np.argmax(wrong.any(1)))
        size = np.where(np.array(held) < 3, 1 / machine.characteristic_length, 1.0)
        entry = int(np.argmax(np.abs(off[pose]) * size))  # what is furthest off, at the machine's size
        name = COMPONENTS[held[entry]]
        value = f"{off[pose, entry] * 1e3:.6g} mm" if held[entry] < 3 else f"{np.rad2deg(off[pose, entry]):.6g} deg"
        raise NotFree(
            f"machine {machine.name} holds {name}: {name_of(pose)} has {name} {value} off home; "
            f"it moves {', '.join(machine.freedom)} only; leave {name} as it is at home"
        )
