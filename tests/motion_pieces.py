"""The pieces in a motion.bin, to change them without a path."""

from types import SimpleNamespace

import numpy as np

from planner.export import plan_files


def load(path):
    """Arrays by name, to be changed."""
    held = list(plan_files.motion_parts(path))
    rest = [np.concatenate([arrays[k] for _, arrays in held]) for k in range(len(plan_files.PIECES))]
    knots = np.concatenate([held[0][0], *(knots[1:] for knots, _ in held[1:])])
    return dict(zip(("knots", *plan_files.PIECES), (knots, *rest), strict=True))


def store(path, pieces):
    plan_files.write_motion(SimpleNamespace(**{name: np.array(values) for name, values in pieces.items()}), path)
