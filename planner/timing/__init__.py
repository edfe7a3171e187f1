"""Solvers: how fast a path can be run within rows of limits, and the classical profiles as baselines."""
