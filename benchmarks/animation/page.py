"""The page of an animation: viser's own, with what its player lacks laid over it.

viser's saved page has the scene, a slider of time, play and pause, speeds from 0.5 to 8 times real time, and a list of
what is in the scene to hide parts by. It has no fixed views, no legend and no text that changes with time: those come
from `animation.html.j2`, by the handles on its client that viser keeps for its own tests. They were seen to work with
viser 1.1; should a later client lack them, the player goes on without.
"""

from collections.abc import Sequence
from html import escape
from math import radians
from typing import Any

import numpy as np

from benchmarks.animation.frames import Frames
from benchmarks.animation.look import PLAIN, PLANNED, RAMP, REALISED, VIEWS, View, rgb_of
from benchmarks.animation.scene import CLOCK, HOLD, recorded
from benchmarks.page import render
from kinematics.array import Array
from kinematics.plain_text import plain
from kinematics.table import SCALES

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob: data:; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; connect-src data: blob:; worker-src data: blob:"
)
"""What a browser lets the page load: nothing but what is in it."""
WIDE, NARROW = 35.0, 2.0
"""degrees: the angle of view in space, and of the three views along axes, which are nearly parallel with that."""
FILLED = 0.85
"""Share of the picture beside the legend that the machine fills."""


LEAST = 0.1
"""Share of the machine's size that its box measures at least each way, that of a flat machine too."""


def page(frames: Frames) -> str:
    """One HTML document that asks no network for anything."""
    title = plain(f"{frames.program} on {frames.machine}")
    head = f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
    document = recorded(frames).replace("<head>", f"<head>{head}", 1)
    document = document.replace("<title>Viser</title>", f"<title>{escape(title)}</title>", 1)
    body = document.rindex("</body>")
    return document[:body] + _overlay(frames) + document[body:]


def _overlay(frames: Frames) -> str:
    seconds = float(frames.t[-1])
    errors = None if frames.errors is None else 1e6 * np.linalg.norm(frames.errors, axis=1).max()
    return render(
        "animation.html.j2",
        {},
        program=frames.program,
        machine=frames.machine,
        views=[{"name": view.name, "label": view.name[0].upper() + view.name[1:]} for view in VIEWS],
        gradient=", ".join(f"{colour} {100 * place:g}%" for place, colour in RAMP),
        what=frames.what,
        tilted=bool(np.isfinite(frames.tilt).any()),
        planned=PLANNED,
        realised=REALISED,
        magnified=None if errors is None else frames.magnified,
        times=f"{frames.magnified:g}",
        largest="" if errors is None else f"{errors:.3g} µm",
        along=len(frames.planned),
        count=len(frames.t),
        step=f"{1e3 * seconds / (len(frames.t) - 1):.3g} ms",
        hold=HOLD,
        data=_data(frames),
    )


def _data(frames: Frames) -> dict[str, Any]:
    """What the page's script goes by; `near`: of every row in every frame, which of `names`, and per mille of it."""
    known, joints = frames.nearest, np.isfinite(frames.tilt).any(0)
    rows, names, which, use = list(known.owners), list(known.limits), known.which, known.use
    if joints.any():
        rows.append("joints")
        most = np.where(joints, np.nan_to_num(frames.tilt), -1.0).argmax(1)
        names += [f"tilt of {pivot.name}" for pivot in frames.pivots]
        which = np.column_stack([which, len(known.limits) + most])
        use = np.column_stack([use, np.take_along_axis(frames.tilt, most[:, None], 1)])
    near = np.stack([which, np.rint(1e3 * use).astype(int)], 2)
    return {
        "clock": CLOCK,
        "t": frames.t.round(6).tolist(),
        "rows": rows,
        "names": names,
        "near": near.tolist(),
        "axes": list(frames.axes),
        "units": [SCALES["human"][unit][0] for unit in frames.units],
        "q": _read(frames.q, frames.units),
        "pose": _read(frames.pose, ("m",) * 3 + ("rad",) * 3),
        "ramp": [[place, rgb_of(colour)] for place, colour in RAMP],
        "plain": PLAIN,
        "views": [_camera(view) for view in VIEWS],
        "filled": FILLED,
        "first": first_view(frames).name,
        "middle": frames.box.mean(0).tolist(),
        "half": (np.maximum(np.ptp(frames.box, axis=0), LEAST * frames.size) / 2).tolist(),
    }


def _read(values: Array, units: Sequence[str]) -> list[list[float]]:
    """Rows in mm and degrees, to a thousandth."""
    factors = [SCALES["human"][unit][1] for unit in units]
    rows: list[list[float]] = (np.round(values * factors, 3) + 0.0).tolist()  # no −0
    return rows


def first_view(frames: Frames) -> View:
    """In space, but from above of a machine that is flat."""
    return next(view for view in VIEWS if view.parallel is frames.flat)


def _camera(view: View) -> dict[str, Any]:
    """From where a view looks, and what is to the right, upwards and towards it in its picture.

    The page knows its window: it puts the camera where all that is drawn fits beside the legend.
    """
    right = view.right / np.linalg.norm(view.right)
    return {
        "name": view.name,
        "up": view.up.tolist(),
        "axes": [axis.tolist() for axis in (right, np.cross(view.back, right), view.back)],
        "fov": radians(NARROW if view.parallel else WIDE),
    }
