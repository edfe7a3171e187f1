"""The pieces in a motion.bin, to change them without a path."""

from types import SimpleNamespace

import numpy as np

from planner.export import motion_file


def load(path):
    """Arrays by name, to be changed."""
    held = list(motion_file.motion_parts(path))
    rest = [
        np.concatenate([part.columns[k] for part in held]) for k in range(len(motion_file.PIECES))
    ]
    knots = np.concatenate([held[0].knots, *(part.knots[1:] for part in held[1:])])
    return dict(zip(("knots", *motion_file.PIECES), (knots, *rest), strict=True))


def store(path, pieces):
    motion_file.write_motion(
        SimpleNamespace(**{name: np.array(values) for name, values in pieces.items()}), path
    )
