"""A trajectory's closed-form pieces as JSON: exact to the last bit, so that a plan can be taken up without solving."""

import json
from pathlib import Path

import numpy as np

from kinematics import Fault, FileError
from planner.actuation import ActuatorPath
from planner.trajectory import Trajectory

PIECES = ("s", "v", "a", "j", "piece")
"""One entry per time piece, as `Trajectory` has them; its knots are one more."""


def write(trajectory: Trajectory, path: Path) -> None:
    """Write knots and pieces; Python's shortest decimals read back as the same floats."""
    path.write_text(json.dumps({name: getattr(trajectory, name).tolist() for name in ("knots", *PIECES)}) + "\n")


def read(path: Path, along: ActuatorPath) -> Trajectory:
    """The trajectory in a file, along its path. Raises FileError where it is damaged or belongs to another path."""
    try:
        table = json.loads(path.read_bytes())
        knots = np.array(table["knots"], float)
        s, v, a, j = (np.array(table[name], float) for name in PIECES[:4])
        piece = np.array(table["piece"], int)
    except (ValueError, TypeError, KeyError) as error:
        raise FileError(str(path), [Fault("", f"no motion can be read from it: {error}")]) from None
    fits = len({values.shape for values in (s, v, a, j, piece)}) == 1 and knots.shape == (len(piece) + 1,)
    if not fits or not np.isfinite(np.concatenate([knots, s, v, a, j])).all() or (np.diff(knots) < 0).any():
        raise FileError(str(path), [Fault("", "its pieces do not make a motion: plan it again")])
    if not len(piece) or piece.min() < 0 or piece.max() >= len(along.breaks) - 1:
        raise FileError(str(path), [Fault("piece", "belongs to another path: plan it again")])
    return Trajectory(along, knots, s, v, a, j, piece)
