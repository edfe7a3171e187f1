"""Drawings of many entities: a sheet of parts, and entities that lie anywhere."""

import random
from math import ceil, sqrt

PART_ENTITIES = 20
"""Entities of one part: an outline of 12 in 6 lines and 6 arcs, 3 slots, 4 holes, and an ellipse or
a spline.
"""


def draw(path, count):
    """Write a sheet of that many entities, and return the number of its contours."""
    from ezdxf.filemanagement import new

    rng = random.Random(1)
    document = new(units=4)
    sheet = document.modelspace()
    parts = count // PART_ENTITIES
    across = ceil(sqrt(parts))
    drawn = []
    for part in range(parts):
        x, y = 60.0 * (part % across), 60.0 * (part // across)
        drawn += draw_outline(rng, x, y)
        for slot in range(3):
            left, low = x + 10 + 10 * slot, y + 8
            corners = [
                (left, low, 0),
                (left + 6, low, 1),
                (left + 6, low + 3, 0),
                (left, low + 3, 1),
            ]
            drawn.append(("add_lwpolyline", (corners,), {"format": "xyb", "close": True}))
        drawn += [
            ("add_circle", ((x + 12 + 9 * hole, y + 20), rng.uniform(1, 3)), {})
            for hole in range(4)
        ]
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


def draw_outline(rng, x, y):
    """A rounded rectangle of 50 × 45 mm, its two long sides parted where half circles are cut in: 6
    lines, 6 arcs.
    """
    lines = [
        ((5, 0), (20, 0)), ((30, 0), (45, 0)), ((50, 5), (50, 40)), ((45, 45), (30, 45)), ((20, 45), (5, 45)),
        ((0, 40), (0, 5)),
    ]  # fmt: skip
    arcs = [
        ((45, 5), 5, 270, 360), ((45, 40), 5, 0, 90), ((5, 40), 5, 90, 180), ((5, 5), 5, 180, 270),
        ((25, 0), 5, 0, 180), ((25, 45), 5, 180, 360),
    ]  # fmt: skip
    drawn = []
    for ends in lines:
        places = [(x + a, y + b) for a, b in ends]
        rng.shuffle(places)
        drawn.append(("add_line", tuple(places), {}))
    return drawn + [
        ("add_arc", ((x + a, y + b), radius, first, last), {})
        for (a, b), radius, first, last in arcs
    ]


def scatter(path, count, splines=False):
    """Write entities of six kinds in turn, or splines only, each a contour."""
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
