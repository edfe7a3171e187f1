"""Actuator forces where only the platform has mass: J⁻ᵀ of the wrench that it needs."""

import numpy as np

from kinematics.array import Array
from kinematics.body import Body
from kinematics.freedom import columns
from kinematics.machine import Machine
from kinematics.motion import Motion, controlled
from kinematics.pose import numbers


def needed_wrench(body: Body, motion: Motion, gravity: Array) -> Array:
    """(N, 6) force and moment about the platform's origin, base frame, that move a body fixed to the platform.

    F = m (p̈ + ω̇ × c + ω × (ω × c) − g),    M = c × F + I ω̇ + ω × I ω,    with c and I turned into the base frame.
    """
    rotation = motion.pose.rotation.as_matrix().reshape(-1, 3, 3)
    arm = rotation @ body.centre
    inertia = rotation @ body.inertia @ rotation.swapaxes(1, 2)
    spin, turn = motion.twist[:, 3:], motion.acceleration[:, 3:]
    at_centre = motion.acceleration[:, :3] + np.cross(turn, arm) + np.cross(spin, np.cross(spin, arm))
    force = body.mass * (at_centre - gravity)
    moment = np.cross(arm, force) + _times(inertia, turn) + np.cross(spin, _times(inertia, spin))
    return np.concatenate([force, moment], 1)


def massless_forces(machine: Machine, motion: Motion, platform: Body, wrench: Array, gravity: Array) -> Array:
    """(N, n) by virtual power, f · q̇ = (F − wrench) · ν for every motion that the machine has: Jᵀ f = Sᵀ (F − wrench).

    ν = S ν_c, the platform's twist by what is controlled; J has the columns of ν_c. Guides bear what is held.
    """
    need = needed_wrench(platform, motion, gravity) - wrench
    jacobian = controlled(machine, numbers(motion.pose), motion.q)
    generalized = _times(_twists(machine, motion).swapaxes(1, 2), need)
    return np.asarray(np.linalg.solve(jacobian.swapaxes(1, 2), generalized[:, :, None])[:, :, 0], float)


def _twists(machine: Machine, motion: Motion) -> Array:
    """S (N, 6, n): the platform's twist of a unit of each controlled component, with what follows."""
    count, n, free = len(motion), len(machine.axes), columns(machine)
    unit = np.zeros((count, 6, n))
    unit[:, free, np.arange(n)] = 1.0
    if not machine.follows:
        return unit
    inputs = machine.inputs(numbers(motion.pose), motion.q)
    still = np.zeros((count, 6))
    carried = [machine.rates_map(np.concatenate([inputs, unit[:, :, k], still], 1)) for k in range(n)]
    return np.stack([rows[:, 2 * n : 2 * n + 6] for rows in carried], 2)


def _times(matrices: Array, vectors: Array) -> Array:
    return np.asarray(np.einsum("nij,nj->ni", matrices, vectors), float)
