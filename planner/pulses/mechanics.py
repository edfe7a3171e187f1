"""What an axis' mechanics make of where its motor stands: its play, then its screw. Compensation is held against it."""

import numpy as np

from kinematics.array import Array
from kinematics.axis import Axis


def play(motor: Array, width: float, before: float) -> Array:
    """(N,) where play of a width leaves what a motor at (N,) pushes: yᵢ = min(max(yᵢ₋₁, mᵢ), mᵢ + width).

    Towards greater q it is pushed at y = m, towards smaller q at y = m + width, and between them it stays where it is:
    the play operator of [Krasnosel'skii and Pokrovskii 1989]. before: y before the first place; a machine that has been
    homed towards greater q starts at y = m, one towards smaller q at the far side (`carried`). Only the turns are gone
    through one by one: along a run that has one sense y depends on where the run began alone.
    """
    if not len(motor):
        return motor
    rises = np.diff(motor) >= 0
    turns = np.flatnonzero(rises[1:] != rises[:-1]) + 1
    held = [min(max(before, float(motor[0])), float(motor[0]) + width)]
    for m in motor[turns].tolist():
        held.append(min(max(held[-1], m), m + width))
    lengths = np.diff(turns, prepend=-1, append=len(motor) - 1)  # a turn is the last place of its run
    return np.asarray(np.minimum(np.maximum(np.repeat(held, lengths), motor), motor + width))


def carried(motor: Array, axis: Axis, before: float) -> Array:
    """(N,) where an axis' play leaves what its motor pushes, which was homed on the side that `pushed` says."""
    return play(motor - axis.backlash if axis.pushed == "-" else motor, axis.backlash, before)


def screw(place: Array, axis: Axis) -> Array:
    """(N,) where the axis is, from home, with its screw at (N,): y + error(y), past either end the error as there."""
    return place if axis.lead_error is None else place + np.interp(place, *np.array(axis.lead_error).T)


def asked_of_screw(wanted: Array, axis: Axis) -> Array:
    """(N,) the inverse of `screw`: between two points the error is linear over where the axis is, too."""
    if axis.lead_error is None:
        return wanted
    counted, error = np.array(axis.lead_error).T
    return np.asarray(wanted - np.interp(wanted, counted + error, error))


def told(axis: Axis, off: float) -> str:
    """The axis' mechanics in words, for those who read what was simulated; empty where it states none.

    off: m or rad by which it is behind at most while play that is made up for is crossed.
    """
    parts = []
    if axis.backlash > 0:
        made = f"made up for, off by up to {1e6 * off:.3g} while crossed" if "backlash" in axis.compensate else "not"
        parts.append(f"play {1e6 * axis.backlash:.4g} ({made})")
    if axis.lead_error is not None:
        most = 1e6 * max(abs(error) for _, error in axis.lead_error)
        parts.append(f"lead error up to {most:.4g} ({'made up for' if 'lead' in axis.compensate else 'not'})")
    return f"{', '.join(parts)} µ{axis.unit}" if parts else ""
