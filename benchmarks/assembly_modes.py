"""How often all forty assembly modes of Dietmaier's platform are found: `python -m benchmarks.assembly_modes`.

Each seed starts from another random complex machine, whose forty solutions are found first, by monodromy.
"""

from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform

from kinematics import Axis, Hexapod
from kinematics.assembly import assembly_modes, generic

SEEDS = 20
# The platform with 40 real assembly modes for one set of leg lengths [Dietmaier 1998]; unit of length as printed.
BASE: list[list[float]] = [
    [0, 0, 0],
    [1.107915, 0, 0],
    [0.549094, 0.756063, 0],
    [0.735077, -0.223935, 0.525991],
    [0.514188, -0.526063, -0.368418],
    [0.590473, 0.094733, -0.205018],
]
PLATFORM: list[list[float]] = [
    [0, 0, 0],
    [0.542805, 0, 0],
    [0.956919, -0.528915, 0],
    [0.665885, -0.353482, 1.402538],
    [0.478359, 1.158742, 0.107672],
    [-0.137087, -0.235121, 0.353913],
]
LENGTHS = [1, 0.645275, 1.086284, 1.503439, 1.281933, 0.771071]


def main() -> None:
    home = RigidTransform.from_translation([0.955868038, -0.046995629, -0.290013283])
    machine = Hexapod(BASE, PLATFORM, axes=[Axis(f"leg{n}") for n in range(1, 7)], home=home)
    print(f"{'seed':>4}{'modes':>7}{'largest residual':>18}{'nearest two':>13}{'start system':>14}{'modes':>9}")
    complete = 0
    for seed in range(SEEDS):
        begin = perf_counter()
        generic(seed)
        ready = perf_counter()
        modes = assembly_modes(machine, LENGTHS, seed=seed)
        done = perf_counter()
        residual = np.abs(machine.inverse(modes) - LENGTHS).max()
        matrices = modes.as_matrix()
        apart = np.abs(matrices[:, None] - matrices).max((2, 3)) + np.diag(np.full(len(modes), np.inf))
        complete += len(modes) == 40
        times = f"{ready - begin:>12.2f} s{done - ready:>7.2f} s"
        print(f"{seed:>4}{len(modes):>7}{residual:>18.1e}{apart.min():>13.3f}{times}")
    print(f"all 40 in {complete} of {SEEDS} seeds")


if __name__ == "__main__":
    main()
