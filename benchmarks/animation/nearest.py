"""Which limit is nearest to its bound at an instant, for every axis and the tool; and how tilted the joints are.

All from the limits' own `value` and `use`, which the certificate is made of too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.array import Array, frozen
from planner.limits import Limit
from planner.limits.tilt import Tilt
from planner.trajectory import State

TOOL = "tool"
"""Who owns what is no axis': the caps of a program."""
NONE = -1
"""In `which`, where nothing limits an owner."""


@dataclass(frozen=True, slots=True)
class Nearest:
    """At N instants, the use of each owner's limit that is nearest to its bound (N, owners), and its index in `limits`.

    owners  the axes, and the tool where anything limits it
    """

    owners: tuple[str, ...]
    limits: tuple[str, ...]
    use: Array
    which: np.ndarray


def nearest(limits: Sequence[Limit], state: State, axes: Sequence[str]) -> Nearest:
    """Of all limits but tilt, which is the joints' own. A clearance between two legs belongs to both."""
    owners = (*axes, TOOL)
    use, which = np.zeros((len(state.t), len(owners))), np.full((len(state.t), len(owners)), NONE)
    for n, limit in enumerate(limits):
        if isinstance(limit, Tilt):
            continue
        value = limit.value(state)
        shares = limit.use(value, value, state.piece)
        for channel, share in zip(limit.channels, shares.T, strict=True):
            for owner in _owners(channel, axes):
                beats = (share > use[:, owner]) | (which[:, owner] == NONE)
                use[beats, owner], which[beats, owner] = share[beats], n
    count = len(owners) if (which[:, -1] != NONE).any() else len(axes)
    names = tuple(limit.name for limit in limits)
    return Nearest(owners[:count], names, frozen(use[:, :count]), frozen(which[:, :count], int))


def tilt_use(limits: Sequence[Limit], state: State, joints: Sequence[str]) -> Array:
    """(N, joints) share of the tilt limit; NaN for joints that have none."""
    found = np.full((len(state.t), len(joints)), np.nan)
    for limit in limits:
        if isinstance(limit, Tilt):
            value = limit.value(state)
            use = limit.use(value, value, state.piece)
            for k, name in enumerate(joints):
                if name in limit.channels:
                    found[:, k] = use[:, limit.channels.index(name)]
    return frozen(found)


def _owners(channel: str, axes: Sequence[str]) -> list[int]:
    """Indices of those a channel belongs to: an axis, both legs of a pair ("leg1–leg2"), else the tool, the last."""
    named = {channel, *channel.split("–")}
    return [n for n, axis in enumerate(axes) if axis in named] or [len(axes)]
