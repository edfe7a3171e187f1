"""Jerk-limited motions by a primal-dual interior-point method with a Riccati recursion."""
