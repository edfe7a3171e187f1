"""How often all forty assembly modes of Dietmaier's platform are found: `python -m
benchmarks.evidence.trials.assembly_modes`.

Each seed starts from another random complex machine, whose forty solutions are found first, by monodromy.
"""

from time import perf_counter

import numpy as np

from benchmarks.evidence.published.conformance import PUBLISHED, dietmaier
from kinematics.analysis.assembly_modes import assembly_modes, solve_generic

SEEDS = 20


def main() -> None:
    machine, lengths = dietmaier(), PUBLISHED["dietmaier"]["lengths"]
    print(f"{'seed':>4}{'modes':>7}{'largest residual':>18}{'nearest two':>13}{'start system':>14}{'modes':>9}")
    complete = 0
    for seed in range(SEEDS):
        begin = perf_counter()
        solve_generic(seed)
        ready = perf_counter()
        modes = assembly_modes(machine, lengths, seed=seed)
        done = perf_counter()
        residual = np.abs(machine.inverse(modes) - lengths).max()
        matrices = modes.as_matrix()
        apart = np.abs(matrices[:, None] - matrices).max((2, 3)) + np.diag(np.full(len(modes), np.inf))
        complete += len(modes) == 40
        times = f"{ready - begin:>12.2f} s{done - ready:>7.2f} s"
        print(f"{seed:>4}{len(modes):>7}{residual:>18.1e}{apart.min():>13.3f}{times}")
    print(f"all 40 in {complete} of {SEEDS} seeds")


if __name__ == "__main__":
    main()
