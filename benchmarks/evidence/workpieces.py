"""G-code as CAM writes it, for cases and tests: shapes of any number of lines, and files by a seed.

A shape lies 25 mm above the home pose of the bundled hexapod. It has the feed `FEED` and mostly
short lines, which `G64 P0.02` lets the planner fit. A file by a seed has features of ordinary CAM:
slow feeds in the material, rapids above it, and no fit.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import count, cycle, islice
from math import cos, hypot, pi, sin
from pathlib import Path

import numpy as np

# mm/min
FEED = 600.0
HEAD = "G21 G90 G17 G64 P0.02"


def spiral(lines: int) -> Iterator[str]:
    """Generate a pocket: an Archimedean spiral in lines of 0.42 mm, begun anew at a width of 9
    mm.
    """
    step, begin = 0.42, 1.0
    growth = 1.5 / (2 * pi)
    yield HEAD
    yield f"G1 X{begin} Y0 Z25 F{FEED:.0f}"
    angle = 0.0
    for _ in range(lines):
        radius = begin + growth * angle
        if radius > 9.0:
            yield "G0 Z26"
            yield f"G0 X{begin} Y0"
            yield "G1 Z25"
            angle = 0.0
            continue
        # the angle whose chord is a step, by the middle of the step
        middle = radius + growth * step / (2 * hypot(radius, growth))
        angle += step / hypot(middle, growth)
        radius = begin + growth * angle
        yield f"G1 X{radius * cos(angle):.3f} Y{radius * sin(angle):.3f}"


def surface(lines: int) -> Iterator[str]:
    """Generate a raster to and fro over a freeform surface, over and over, with z in every line."""
    columns, rows = 41, 32
    yield HEAD
    yield f"F{FEED:.0f}"
    for number in range(lines):
        row, column = divmod(number, columns)
        x = 0.4 * column - 8.0
        x = -x if row % 2 else x
        # the rows go up and down again
        y = 0.5 * (rows - abs(row % (2 * rows) - rows)) - 8.0
        z = 25 + sin(0.6 * x) * cos(0.5 * y) + 0.1 * sin(1.5 * x + y)
        yield f"G1 X{x:.3f} Y{y:.3f} Z{z:.3f}"


LETTERS = {
    "P": "0,0 0,6 2.5,6 3.6,5.4 4,4.5 3.6,3.6 2.5,3 0,3",
    "U": "0,6 0,2 0.4,0.8 1.3,0.1 2,0 2.7,0.1 3.6,0.8 4,2 4,6",
    "L": "0,6 0,0 3.6,0",
    "S": (
        "3.8,5 3.2,5.7 2,6 0.8,5.6 0.3,4.6 0.8,3.6 2,3.1 3.3,2.5 3.8,1.5 3.2,0.4 2,0 0.8,0.3 0.2,1"
    ),
    "E": "3.8,0 0,0 0,6 3.8,6 / 0,3 3,3",
}
"""Letters 4 wide and 6 high: points "x,y" of their strokes, with a slash between two strokes."""


def trace_letter(letter: str) -> Iterator[np.ndarray]:
    """Generate the points (N, 2) of each stroke."""
    for stroke in LETTERS[letter].split("/"):
        yield np.array([point.split(",") for point in stroke.split()], float)


def engraving(lines: int, wait: str = "") -> Iterator[str]:
    """Generate letters, row below row. wait: block where the pen has come down, "" for none."""
    yield HEAD
    yield from islice(engrave_rows(wait), lines)


def engrave_rows(wait: str) -> Iterator[str]:
    """Generate the blocks of an engraving without end. The pen is lifted between strokes."""
    for row in count():
        for place, letter in enumerate("PULSE"):
            corner = np.array([2.5 * place - 6, 4 - 4 * (row % 4)])
            for stroke in trace_letter(letter):
                first, *others = corner + stroke / 2
                yield f"G0 X{first[0]:.3f} Y{first[1]:.3f} Z26"
                yield f"G1 Z25 F{FEED:.0f}"
                if wait:
                    yield wait
                for x, y in others:
                    yield f"G1 X{x:.3f} Y{y:.3f}"
                yield "G0 Z26"


SLOTS = """\
G1 X5 Y-2
G3 X5 Y2 I0 J2
G1 X-5 Y2
G3 X-5 Y-2 I0 J-2
G2 X5 Y-2 I5 J-3
G2 X-5 Y-2 I-5 J3
G1 X5 Y-2
G3 X5 Y2 I0 J2
G1 X-5 Y2
G3 X-5 Y-2 I0 J-2
G3 X-5.1 Y-2.1 I-0.1 J0
G1 X-5 Y-2"""


def slots(lines: int) -> Iterator[str]:
    """Generate slots, whose arcs are tangent to their lines, and lenses with corners between
    arcs.
    """
    yield HEAD
    yield f"G1 X-5 Y-2 Z25 F{FEED:.0f}"
    yield from islice(cycle(SLOTS.splitlines()), lines)


SHAPES: dict[str, Callable[[int], Iterator[str]]] = {
    "spiral": spiral,
    "surface": surface,
    "engraving": engraving,
    "marking": partial(engraving, wait="G4 P0.05"),
    "slots": slots,
}
"""Generators of about as many lines as they are given."""


def write_shape(name: str, lines: int, file: Path) -> Path:
    """Write a shape of about that many lines, and return the file."""
    with file.open("w") as out:
        out.writelines(f"{line}\n" for line in SHAPES[name](lines))
        out.write("M2\n")
    return file


# mm/min: the feeds of ordinary materials, from engraved steel to foam.
FEEDS = 5.0, 600.0
# mm: height of the rapids, and how far the features of a file lie from its zero.
CLEARANCE, REACH = 5.0, 300.0
# Features of a file, at most.
MAX_FEATURES = 5
MM_PER_INCH = 25.4

Move = tuple[str, dict[str, float]]
"""A G word and its arguments, in mm and mm/min."""


# A feature begins with the tool at CLEARANCE and ends there. It lies around its own zero.


def cut_contour(rng: np.random.Generator) -> Iterator[Move]:
    """Generate the outline of a plate with round corners, in one or two depths."""
    width, height = rng.uniform(10.0, 80.0, 2)
    radius = rng.uniform(0.05, 0.5) * min(width, height)
    feed = draw_feed(rng)
    yield "G0", {"X": radius, "Y": 0.0}
    for depth in range(1, int(rng.integers(2, 4))):
        yield "G1", {"Z": -float(depth), "F": feed * rng.uniform(0.2, 1.0)}
        yield "G1", {"X": width - radius, "Y": 0.0, "F": feed}
        yield "G3", {"X": width, "Y": radius, "I": 0.0, "J": radius}
        yield "G1", {"X": width, "Y": height - radius}
        yield "G3", {"X": width - radius, "Y": height, "I": -radius, "J": 0.0}
        yield "G1", {"X": radius, "Y": height}
        yield "G3", {"X": 0.0, "Y": height - radius, "I": 0.0, "J": -radius}
        yield "G1", {"X": 0.0, "Y": radius}
        yield "G3", {"X": radius, "Y": 0.0, "I": radius, "J": 0.0}
    yield "G0", {"Z": CLEARANCE}


def cut_pocket(rng: np.random.Generator) -> Iterator[Move]:
    """Generate a pocket: a ramp into the material, a raster, and the walls."""
    width, height = rng.uniform(5.0, 40.0, 2)
    rows = int(rng.integers(3, 8))
    feed = draw_feed(rng)
    yield "G0", {"X": 0.0, "Y": 0.0}
    yield "G1", {"Z": 0.0, "F": feed}
    yield "G1", {"X": width, "Z": -1.0, "F": feed / 2}
    yield "G1", {"X": 0.0, "F": feed}
    for row in range(1, rows):
        yield "G1", {"Y": height * row / (rows - 1)}
        yield "G1", {"X": width if row % 2 else 0.0}
    for x, y in ((0.0, height), (0.0, 0.0), (width, 0.0), (width, height), (0.0, height)):
        yield "G1", {"X": x, "Y": y, "F": feed * 0.8}
    yield "G0", {"Z": CLEARANCE}


def cut_bore(rng: np.random.Generator) -> Iterator[Move]:
    """Generate a helix down into the material and a full circle at its bottom."""
    radius = rng.uniform(1.0, 15.0)
    feed = draw_feed(rng)
    yield "G0", {"X": radius, "Y": 0.0}
    yield "G1", {"Z": 0.2, "F": feed}
    for turn in range(1, int(rng.integers(2, 6))):
        yield "G2", {"X": radius, "Y": 0.0, "Z": -0.5 * turn, "I": -radius, "J": 0.0}
    yield "G2", {"X": radius, "Y": 0.0, "I": -radius, "J": 0.0}
    yield "G1", {"X": 0.0}
    yield "G0", {"Z": CLEARANCE}


def drill_holes(rng: np.random.Generator) -> Iterator[Move]:
    """Generate a row of holes, each drilled in steps with the chips cleared between them."""
    pitch = rng.uniform(2.0, 50.0)
    feed = draw_feed(rng)
    steps = int(rng.integers(1, 4))
    for hole in range(int(rng.integers(2, 6))):
        yield "G0", {"X": pitch * hole, "Y": 0.0}
        for step in range(1, steps + 1):
            yield "G0", {"Z": 1.5 - step}
            yield "G1", {"Z": -float(step), "F": feed}
            yield "G0", {"Z": 1.0}
        yield "G0", {"Z": CLEARANCE}


def engrave_letters(rng: np.random.Generator) -> Iterator[Move]:
    """Generate letters of straight strokes, 1.2 to 12 mm high."""
    scale = rng.uniform(0.2, 2.0)
    feed = draw_feed(rng)
    for place, letter in enumerate(rng.choice([*LETTERS], int(rng.integers(1, 4)))):
        for stroke in trace_letter(letter):
            first, *others = scale * (stroke + np.array([5 * place, 0]))
            yield "G0", {"X": first[0], "Y": first[1]}
            yield "G1", {"Z": -0.2, "F": feed / 2}
            for x, y in others:
                yield "G1", {"X": x, "Y": y, "F": feed}
            yield "G0", {"Z": CLEARANCE}


def engrave_curve(rng: np.random.Generator) -> Iterator[Move]:
    """Generate a smooth closed curve in short lines: what CAM makes of a spline."""
    lines = int(rng.integers(12, 30))
    size, lobes = rng.uniform(2.0, 20.0), int(rng.integers(2, 4))
    wave = rng.uniform(0.05, 0.2)
    feed = draw_feed(rng)
    angle = np.linspace(0.0, 2 * pi, lines + 1)
    radius = size * (1 + wave * np.cos(lobes * angle))
    first, *others = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    yield "G0", {"X": first[0], "Y": first[1]}
    yield "G1", {"Z": -0.2, "F": feed / 2}
    for x, y in others:
        yield "G1", {"X": x, "Y": y, "F": feed}
    yield "G0", {"Z": CLEARANCE}


FEATURES: dict[str, Callable[[np.random.Generator], Iterator[Move]]] = {
    "contour": cut_contour,
    "pocket": cut_pocket,
    "bore": cut_bore,
    "drilling": drill_holes,
    "letters": engrave_letters,
    "curve": engrave_curve,
}


def draw_feed(rng: np.random.Generator) -> float:
    """Draw a feed in mm/min, evenly on a logarithmic scale."""
    low, high = np.log(FEEDS)
    return float(np.exp(rng.uniform(low, high)))


def generate_cam_file(seed: int, features: Sequence[str] | None = None) -> str:
    """Generate the text of a G-code file.

    features: names in FEATURES. None: one to MAX_FEATURES of them, drawn by the seed.
    """
    rng = np.random.default_rng([seed, 32])
    if features is None:
        features = rng.choice([*FEATURES], int(rng.integers(1, MAX_FEATURES + 1))).tolist()
    inches = rng.random() < 0.25
    lines = [f"{'G20' if inches else 'G21'} G90 G17", f"S{rng.integers(5, 24)}000 M3"]
    lines.append(write_move(("G0", {"Z": CLEARANCE}), {}, inches))
    for name in features:
        x, y = rng.uniform(-REACH, REACH, 2)
        lines += [write_move(move, {"X": x, "Y": y}, inches) for move in FEATURES[name](rng)]
    return "\n".join([*lines, "M5", "M2", ""])


def write_move(move: Move, origin: dict[str, float], inches: bool) -> str:
    """Return the block of a move of a feature at `origin` (mm), rounded as CAM rounds it."""
    word, arguments = move
    digits, unit = (4, MM_PER_INCH) if inches else (3, 1.0)
    words = [word]
    for letter, value in arguments.items():
        words.append(f"{letter}{(value + origin.get(letter, 0.0)) / unit:.{digits}f}")
    return " ".join(words)
