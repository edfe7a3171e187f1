"""How long a drawing of 10 000 entities, or a G-code file of 100 000 lines, takes to become a program: `python -m
benchmarks.evidence.speed.reading --kind sheet|mixed|splines|gcode`.

`sheet`: parts of a sheet, as a drawing program leaves them: outlines of lines and arcs, shuffled and turned round;
slots as polylines with bulges; holes; a share of ellipses and splines. `mixed` is equal sixths of lines, arcs, circles,
polylines, ellipses and splines, `splines` those only, each entity a contour: the most that there is to fit. They need
the extra `cad`. `gcode` is as a controller would get it: numbered lines of four decimals, one in ten an arc, rapids,
comments.

Time of the processor, the least of a few, from file to program: reading, chaining, the order of contours and the way
between them; and of the outline, that the figure and the length are from.
"""

import argparse
import random
from collections.abc import Callable
from functools import partial
from math import ceil, cos, pi, sin, sqrt
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.evidence.measuring import time_calls
from planner import import_program

ENTITIES, LINES, REPEATS = 10_000, 100_000, 3
MAX_SECONDS = {"dxf": 10.0, "gcode": 2.0}
"""What is asked for."""
PART_ENTITIES = 20
"""Entities of one part: an outline of 12 in 6 lines and 6 arcs, 3 slots, 4 holes, and an ellipse or a spline."""


def draw(path: Path, count: int) -> int:
    """A sheet of that many entities; how many contours they are."""
    from ezdxf.filemanagement import new

    rng = random.Random(1)
    document = new(units=4)
    sheet = document.modelspace()
    parts = count // PART_ENTITIES
    across = ceil(sqrt(parts))
    drawn: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []
    for part in range(parts):
        x, y = 60.0 * (part % across), 60.0 * (part // across)
        drawn += _outline(rng, x, y)
        for slot in range(3):
            left, low = x + 10 + 10 * slot, y + 8
            corners = [(left, low, 0), (left + 6, low, 1), (left + 6, low + 3, 0), (left, low + 3, 1)]
            drawn.append(("add_lwpolyline", (corners,), {"format": "xyb", "close": True}))
        drawn += [("add_circle", ((x + 12 + 9 * hole, y + 20), rng.uniform(1, 3)), {}) for hole in range(4)]
        if part % 2:
            drawn.append(("add_ellipse", ((x + 25, y + 34), (8, 0), rng.uniform(0.3, 0.9)), {}))
        else:
            through = [(x + 10 + 6 * k, y + rng.uniform(28, 40)) for k in range(6)]
            drawn.append(("add_spline", (through,), {}))
    rng.shuffle(drawn)
    for name, given, options in drawn:
        getattr(sheet, name)(*given, **options)
    document.saveas(path)
    return parts * 9


def _outline(rng: random.Random, x: float, y: float) -> list[tuple[str, tuple[Any, ...], dict[str, Any]]]:
    """A rounded rectangle of 50 × 45 mm, its two long sides parted where half circles are cut in: 6 lines, 6 arcs."""
    lines = [
        ((5, 0), (20, 0)), ((30, 0), (45, 0)), ((50, 5), (50, 40)), ((45, 45), (30, 45)), ((20, 45), (5, 45)),
        ((0, 40), (0, 5)),
    ]  # fmt: skip
    arcs = [
        ((45, 5), 5, 270, 360), ((45, 40), 5, 0, 90), ((5, 40), 5, 90, 180), ((5, 5), 5, 180, 270),
        ((25, 0), 5, 0, 180), ((25, 45), 5, 180, 360),
    ]  # fmt: skip
    drawn: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []
    for ends in lines:
        places = [(x + a, y + b) for a, b in ends]
        rng.shuffle(places)
        drawn.append(("add_line", tuple(places), {}))
    return drawn + [("add_arc", ((x + a, y + b), radius, first, last), {}) for (a, b), radius, first, last in arcs]


def scatter(path: Path, count: int, splines: bool = False) -> int:
    """Entities that lie anywhere, of six kinds in turn or splines only; how many contours they are."""
    from ezdxf.filemanagement import new

    rng = random.Random(5)
    document = new(units=4)
    sheet = document.modelspace()
    for nth in range(count):
        x, y = rng.uniform(0, 500), rng.uniform(0, 500)
        match 5 if splines else nth % 6:
            case 0:
                sheet.add_circle((x, y), rng.uniform(0.5, 3))
            case 1:
                sheet.add_arc((x, y), 2, 10, 200)
            case 2:
                sheet.add_line((x, y), (x + 3, y + 1))
            case 3:
                corners = [(x, y, 0.3), (x + 2, y, 0), (x + 2, y + 2, -0.2)]
                sheet.add_lwpolyline(corners, format="xyb", close=True)
            case 4:
                sheet.add_ellipse((x, y), (2, 0), 0.4)
            case _:
                sheet.add_spline([(x, y), (x + 3, y + rng.random()), (x + 5, y - 2), (x + 8, y)])
    document.saveas(path)
    return count


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


KINDS: dict[str, Callable[[Path, int], int]] = {
    "sheet": draw,
    "mixed": scatter,
    "splines": partial(scatter, splines=True),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", choices=[*KINDS, "gcode"], default="sheet")
    kind = parser.parse_args().kind
    with TemporaryDirectory() as folder:
        path = Path(folder) / ("program.nc" if kind == "gcode" else "sheet.dxf")
        if kind == "gcode":
            path.write_text("\n".join(make_blocks(LINES)), encoding="ascii")
            found, took = time_calls(lambda: import_program(path), REPEATS)
            said, allowed = f"{LINES} lines", MAX_SECONDS["gcode"]
        else:
            said, allowed = f"{ENTITIES} entities, {KINDS[kind](path, ENTITIES)} contours", MAX_SECONDS["dxf"]
            found, took = time_calls(lambda: import_program(path, retract=5e-3, speed=0.02), REPEATS)
    _, (drawn,) = time_calls(lambda: found.outline)
    print(
        f"{kind}: {said}, {len(found.program.segments)} segments: {min(took):.2f} s, "
        f"and {drawn:.2f} s for the outline; at most {allowed} s are allowed; {'; '.join(found.warnings)}"
    )


if __name__ == "__main__":
    main()
