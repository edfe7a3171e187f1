"""The smoothest motion of a stated duration by IPOPT: a second opinion on our own solver."""

from dataclasses import replace

import casadi as ca

from benchmarks.evidence.peers.casadi_ import CasadiProblem
from planner.timing.order3.pose import SHORTEST_STATED


class SmoothestProblem(CasadiProblem):
    """The least ∫ Σ r² dt by the trapezoidal rule; jerks (N, 2, A, 3) as in `pose_smoothest`."""

    shortest = SHORTEST_STATED

    def __init__(self, problem, jerks, guess):
        self.jerks = jerks
        super().__init__(problem, guess, "ipopt")

    def weigh(self, start, end, h):
        """Count the cost in the guess'; the duration, in units of the guess', is 1."""
        v, a, j, length = ca.vertsplit(ca.DM(self.start))
        guess_end = v + length * (a + length * j / 2), a + length * j, j
        guess = self.roughness((v, a, j), guess_end, length)
        return self.roughness(start, end, h) / guess, [ca.sum2(h) - 1]

    def roughness(self, start, end, h):
        """Sum r² at both ends of all intervals."""
        scaled = self.jerks * [1.0, 3 * self.length, self.length**2]
        total = 0
        for side, (v, a, j) in enumerate((start, end)):
            for third, second, first in scaled[:, side].transpose(1, 2, 0):
                rate = third[None] * j + second[None] * (v * a) + first[None] * v**3
                total += ca.sum2(h / 2 * rate**2)
        return total


def smooth_by_ipopt(problem, jerks, guess):
    """Find the smoothest motion of the guess' duration (4, N)."""
    solution = SmoothestProblem(problem, jerks, guess).solve()
    profile = solution.require_profile()
    return replace(solution, profile=profile.slowed(guess[3].sum() / profile.duration))
