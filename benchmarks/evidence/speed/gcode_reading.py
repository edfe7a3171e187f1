"""How long a G-code file of 100 000 lines takes to read: python -m benchmarks.evidence.speed.gcode_reading

As a controller would get it: numbered lines of four decimals, one in ten an arc, rapids, comments. Time of the
processor, the least of a few.
"""

import random
from math import cos, pi, sin
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

from planner import import_program

LINES, TIMES = 100_000, 3
SECONDS = 2.0
"""What is asked for."""


def make_blocks(count: int) -> list[str]:
    """Numbered blocks in a space of 30 mm; arcs end on their circles to rounding."""
    rng = random.Random(1)
    made, x, y = ["%", "(reading)", "G21 G90 G17 G64 P0.02", "G0 X0 Y0 Z25", "F1800"], 0.0, 0.0
    while len(made) < count - 1:
        n = len(made)
        if n % 10 == 0:
            radius, begin = rng.uniform(1, 5), rng.uniform(0, 2 * pi)
            i, j = radius * cos(begin), radius * sin(begin)
            end = begin + pi + rng.uniform(0.3, 5)
            x, y = round(x + i + radius * cos(end), 4), round(y + j + radius * sin(end), 4)
            made.append(f"N{n} G3 X{x:.4f} Y{y:.4f} I{i:.4f} J{j:.4f}")
        elif n % 50 == 1:
            x, y = rng.uniform(-15, 15), rng.uniform(-15, 15)
            made.append(f"N{n} G0 X{x:.4f} Y{y:.4f} (rapid)")
        else:
            x, y = x + rng.uniform(-0.5, 0.5), y + rng.uniform(-0.5, 0.5)
            made.append(f"N{n} G1 X{x:.4f} Y{y:.4f} Z{25 + rng.random():.4f}")
        x, y = round(x, 4), round(y, 4)
    return [*made, "M2"]


def main() -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "reading.nc"
        path.write_text("\n".join(make_blocks(LINES)), encoding="ascii")
        took, segments = [], 0
        for _ in range(TIMES):
            begin = process_time()
            segments = len(import_program(path).program.segments)
            took.append(process_time() - begin)
    print(f"{LINES} lines, {segments} segments: {min(took):.2f} s, at most {SECONDS} s are allowed")


if __name__ == "__main__":
    main()
