"""A plan as a picture that moves, and as four that stand still."""

from benchmarks.animation.animate import animate
from benchmarks.animation.stills import four_views, save_four_views

__all__ = ["animate", "four_views", "save_four_views"]
