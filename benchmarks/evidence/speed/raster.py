"""A program of any length: a zig-zag raster of lines, half circles and stops, layer upon layer.

python -m benchmarks.evidence.speed.raster         the file of its first 100 segments
python -m benchmarks.evidence.speed.raster 5000    of so many
"""

import sys
from collections.abc import Iterator

import numpy as np

from planner.program.model import Arc, Line, Program, Segment
from planner.program.program_writer import program_toml

# m: the lines of a row, the way between two rows, between two layers, and of the first layer above home.
STEP, PITCH, RISE, HEIGHT = 2e-3, 1e-3, 1e-3, 20e-3
# Lines of a row, and rows of a layer.
LINES, ROWS = 3, 16


def raster(segments: int) -> Program:
    """The first so many segments of the raster, relative to home; on the hexapod a thousand take some minutes."""
    endless = _segments()
    return Program(tuple(next(endless) for _ in range(segments)), name=f"raster-{segments}")


def _segments() -> Iterator[Segment]:
    """Rows to and fro along x about y = 0, half circles from each row to the next; every layer runs back over the last.

    Layers rise from the height to 10 mm above it and fall again, so the raster stays in the machine's travel.
    """
    x, y, z = -LINES * STEP / 2, -(ROWS - 1) * PITCH / 2, HEIGHT
    yield Line(np.array([x, y, z]))
    along, across, up = 1.0, 1.0, 1.0
    layer = 0
    while True:
        for row in range(ROWS):
            for _ in range(LINES):
                x += along * STEP
                yield Line(np.array([x, y, z]))
            if row < ROWS - 1:
                y += across * PITCH
                yield Arc(np.array([x, y - across * PITCH / 2, z]), np.array([0.0, 0.0, 1.0]), along * across * np.pi)
            along = -along
        across = -across
        layer += 1
        if layer % 10 == 0:
            up = -up
        z += up * RISE
        yield Line(np.array([x, y, z]))


def main() -> None:
    """Print the program file of so many segments."""
    print(program_toml(raster(int(sys.argv[1]) if len(sys.argv) > 1 else 100)), end="")


if __name__ == "__main__":
    main()
