"""A plan as a picture that moves, and as one that stands still."""

from benchmarks.animation.animate import animate

__all__ = ["animate"]
