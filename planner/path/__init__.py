"""Geometry in space: the pose as a smooth function of path length, piece by piece."""
