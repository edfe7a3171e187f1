"""Solvers under limits on speed and acceleration, and straight runs in closed form (at order 2 and
3).
"""
