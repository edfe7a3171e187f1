"""The animation of a plan as a file: one HTML document, viser's own page with what its player lacks
laid over it.

viser's saved page has the scene, a slider of time, play and pause, speeds from 0.5 to 8 times real
time, and a list of what is in the scene to hide parts by. It has no fixed views, no legend and no
text that changes with time: those come from `animation.html.j2`, by the handles on its client that
viser keeps for its own tests. They were seen to work with viser 1.1; should a later client lack
them, the player goes on without.

Only this file imports viser. A server is opened on loopback at a free port while the scene is made,
since viser's scenes belong to servers; nothing connects to it. What moves goes as positions, turns,
lengths and colours of a batch of one cylinder and one of a sphere: no mesh is sent twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.animation.frames import (
    NO_LIMIT_COLOUR,
    PLANNED_COLOUR,
    RAMP,
    REALISED_COLOUR,
    TOOL,
    VIEWS,
    AnimatablePlan,
    Frames,
    View,
    colour_uses,
    compute_frames,
    even_instants,
    parse_colour,
)
from benchmarks.reports.page import render
from kinematics.files.atomic_files import Destination, require_folder
from kinematics.files.plain_text import plain
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import check_arguments
from kinematics.foundation.table import SCALES
from kinematics.machine.kind import Bar, Sort

if TYPE_CHECKING:
    from viser import SceneApi, ViserServer

RADII: dict[Sort, float] = {"frame": 0.005, "actuator": 0.006, "link": 0.010, "platform": 0.007}
"""Radii of bars, as shares of the size of the scene."""
BARREL, BARREL_LENGTH_SHARE = 0.011, 0.6
"""An actuator's outer tube: its radius as such a share, and its length as a share of the least that
the bar has.
"""
MIN_BAR_LENGTH = 1e-12
"""m: shorter bars have no direction."""


@dataclass(frozen=True, slots=True)
class Solids:
    """Cylinders along z of unit length and radius in N frames: centres (N, k, 3), quaternions wxyz
    (N, k, 4), scales (N, k, 3); owners (k,): the axis of each, or none.
    """

    centres: Array
    turns: Array
    scales: Array
    owners: tuple[str, ...]


def make_cylinders(bars: Sequence[Bar], ends: Array, size: float) -> Solids:
    """Return the bodies of bars with ends (N, bars, 2, 3).

    An actuator is a rod in a tube of constant length.
    """
    parts = [part for k, bar in enumerate(bars) for part in _bar_cylinders(bar, ends[:, k], size)]
    start, end = (np.stack([part[n] for part in parts], 1) for n in (0, 1))
    radius = np.broadcast_to([part[2] for part in parts], start.shape[:2])
    way = end - start
    length = np.linalg.norm(way, axis=2)
    scales = np.stack([radius, radius, length], 2)
    return Solids(
        (start + end) / 2, _bar_rotations(way, length), scales, tuple(part[3] for part in parts)
    )


def _bar_cylinders(bar: Bar, ends: Array, size: float) -> Iterator[tuple[Array, Array, float, str]]:
    """Return start and end (N, 3), radius and axis of each body of a bar."""
    start, end = ends[:, 0], ends[:, 1]
    yield start, end, RADII[bar.sort] * size, bar.axis
    if bar.sort == "actuator":
        way = end - start
        length = np.linalg.norm(way, axis=1, keepdims=True)
        yield (
            start,
            start + way * (BARREL_LENGTH_SHARE * length.min() / np.maximum(length, MIN_BAR_LENGTH)),
            BARREL * size,
            bar.axis,
        )


def _bar_rotations(way: Array, length: Array) -> Array:
    """(N, k, 4) the shortest turns of z to ways (N, k, 3): (1 + z·d, z × d), normalised; about x
    where d is −z.
    """
    x, y, z = np.moveaxis(way / np.maximum(length, MIN_BAR_LENGTH)[..., None], 2, 0)
    turn = np.stack([1 + z, -y, x, np.zeros_like(z)], -1)
    turn[1 + z < MIN_BAR_LENGTH] = [0.0, 1.0, 0.0, 0.0]
    return np.asarray(turn / np.linalg.norm(turn, axis=-1, keepdims=True))


END_HOLD_TIME = 0.5
"""s that the last frame stays, before viser's player begins again."""
CLOCK = "/time"
"""A frame without axes whose x is the time of the frame shown, in s: by it the page knows where the
player is.
"""
BALL, BASE_AXES_LENGTH = 0.012, 0.12
"""Radius of joints and tool and the length of the base frame's axes, as shares of the size of all
that is drawn.
"""
SKY, SUN = 1.9, 1.0
"""Light from all over, and from aside above."""
CYLINDER_SIDES = 16
"""Sides of the cylinders."""
GROUND_CELLS = 10
"""Of the grid on the ground, over the size of all that is drawn."""


def record_scene(frames: Frames) -> str:
    """The page as viser makes it, its client and the recording in one HTML document; 1 s in it is 1
    s of the plan.
    """
    import trimesh  # comes with viser

    size, bars = frames.size, make_cylinders(frames.bars, frames.placed.bars, frames.size)
    tints = colour_uses(frames.use_of(bars.owners))
    places = np.concatenate([frames.placed.pivots, frames.tool[:, None]], 1)
    marks = colour_uses(np.concatenate([frames.tilt, frames.use_of([TOOL])], 1))
    rod = trimesh.creation.cylinder(radius=1.0, height=1.0, sections=CYLINDER_SIDES)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=BALL * size)
    with _server() as server:
        scene = server.scene
        _add_surroundings(scene, frames)
        clock = scene.add_frame(CLOCK, show_axes=False)
        rods = scene.add_batched_meshes_simple(
            "/machine/bars",
            rod.vertices,
            rod.faces,
            bars.turns[0],
            bars.centres[0],
            batched_scales=bars.scales[0],
            batched_colors=tints[0],
            flat_shading=True,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )
        balls = scene.add_batched_meshes_simple(
            "/machine/joints",
            ball.vertices,
            ball.faces,
            np.tile([1.0, 0.0, 0.0, 0.0], (places.shape[1], 1)),
            places[0],
            batched_colors=marks[0],
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )
        recording = server.get_scene_serializer()
        for k in range(1, len(frames.t)):
            recording.insert_sleep(float(frames.t[k] - frames.t[k - 1]))
            clock.position = (float(frames.t[k]), 0.0, 0.0)
            rods.batched_positions = _as_float32(bars.centres[k])
            rods.batched_wxyzs = _as_float32(bars.turns[k])
            rods.batched_scales = _as_float32(bars.scales[k])
            rods.batched_colors = tints[k]
            balls.batched_positions = _as_float32(places[k])
            balls.batched_colors = marks[k]
        recording.insert_sleep(END_HOLD_TIME)
        return recording.as_html()


def _add_surroundings(scene: SceneApi, frames: Frames) -> None:
    """Add the ground, the axes of the base frame, and both paths, which do not move."""
    size, (low, high) = frames.size, frames.box
    middle = (low + high) / 2
    # viser's own surrounding and lights bleach colours that are to be read
    scene.configure_environment_map(hdri=None)
    scene.configure_default_lights(enabled=False)
    scene.add_light_hemisphere("/light/sky", ground_color=(190, 190, 190), intensity=SKY)
    sun = scene.add_light_directional("/light/sun", intensity=SUN)
    sun.position = middle + size * np.array([1.0, -2.0, 2.0])
    ground = scene.add_grid(
        "/ground",
        1.6 * size,
        1.6 * size,
        cell_size=size / GROUND_CELLS,
        section_size=size,
        shadow_opacity=0.0,
    )
    ground.position = (float(middle[0]), float(middle[1]), float(low[2] - 0.02 * size))
    scene.add_frame(
        "/base frame", axes_length=BASE_AXES_LENGTH * size, axes_radius=BASE_AXES_LENGTH * size / 30
    )
    for name, path, colour, pixels in (
        ("planned", frames.planned, PLANNED_COLOUR, 2.5),
        ("realised", frames.realised, REALISED_COLOUR, 1.5),
    ):
        if path is not None:
            pieces = _as_float32(np.stack([path[:-1], path[1:]], 1))
            scene.add_line_segments(
                f"/path/{name}",
                pieces,
                parse_colour(colour),
                thickness=pixels,
                thickness_units="screen",
            )


@contextmanager
def _server() -> Iterator[ViserServer]:
    """A server that prints no messages, which would mix with the data on stdout."""
    from rich import get_console
    from viser import ViserServer

    console = get_console()
    before, console.quiet = console.quiet, True
    try:
        server = ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            yield server
        finally:
            server.stop()
    finally:
        console.quiet = before


def _as_float32(values: Array) -> np.ndarray:
    return values.astype(np.float32)


FRAMES, MAX_FRAMES = 240, 5000
"""Frames by default, and at most: more would make pages that browsers cannot open."""


@check_arguments()
def animate(
    plan: AnimatablePlan,
    path: str | Path,
    *,
    frames: int = FRAMES,
    magnify: float | None = None,
    force: bool = False,
) -> Path:
    """Write an animation of the machine along a plan as an HTML page, in 3-D and real time.

    Parameters
    ----------
    plan
        What `plan` or `load_plan` gave.
    path
        Of the page.
    frames
        How many, evenly from start to end.
    magnify
        How many times the error of the pulses' path is drawn; 1 is true scale. None: as large as
        can be seen.
    force
        Replace a file that is there.

    Returns
    -------
    Path
        Of the page.

    Raises
    ------
    MotionError
        The file exists, or its folder does not.
    """
    require_folder(f"animate {path}", Path(path))
    target = Destination(Path(path), force=force, remedy="give force=True to replace it")
    target.write(document(plan, frames, magnify))
    return target.path


def document(plan: AnimatablePlan, frames: int = FRAMES, magnify: float | None = None) -> str:
    """The page as text."""

    if not 2 <= frames <= MAX_FRAMES:
        raise MotionError(f"frames {frames}: an animation has from 2 to {MAX_FRAMES}")
    if magnify is not None and not magnify > 0:
        raise MotionError(f"magnify {magnify}: the magnification must be above 0; 1 is true scale")
    return compose_page(compute_frames(plan, even_instants(plan.trajectory, frames), magnify))


POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob: data:; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; connect-src data: blob:; worker-src data: blob:"
)
"""Content policy of the page: a browser loads only the content of the page itself."""
QUIET = """console.log = () => {};
const warn = console.warn;
console.warn = (...told) => String(told[0]).startsWith("THREE.Clock") || warn(...told);"""
"""viser tells the console what browser it is in, how fast it draws, and of what three.js advises
against.
"""
DARK = ("{darkMode:false}", '{darkMode:matchMedia("(prefers-color-scheme: dark)").matches}')
"""The setting in viser's page by which it is dark, and what it becomes: as the browser is when the
page opens.
"""
SPACE_VIEW_ANGLE, AXIS_VIEW_ANGLE = 35.0, 2.0
"""degrees: the angle of view in space, and of the three views along axes, which are nearly parallel
with that.
"""
FILLED_SHARE = 0.85
"""Share of the picture beside the legend that the machine fills."""


MIN_BOX_SHARE = 0.1
"""Share of the machine's size that its box measures at least each way, that of a flat machine
too.
"""


def compose_page(frames: Frames) -> str:
    """One HTML document that asks no network for anything."""
    title = plain(f"{frames.program} on {frames.machine}")
    head = f'<meta http-equiv="Content-Security-Policy" content="{POLICY}"><script>{QUIET}</script>'
    document = record_scene(frames).replace("<head>", f"<head>{head}", 1)
    document = document.replace(*DARK, 1)
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
        views=[
            {"name": view.name, "label": view.name[0].upper() + view.name[1:]} for view in VIEWS
        ],
        gradient=", ".join(f"{colour} {100 * place:g}%" for place, colour in RAMP),
        what=frames.what,
        bare=all(bar.sort == "platform" for bar in frames.bars),
        tilted=bool(np.isfinite(frames.tilt).any()),
        planned=PLANNED_COLOUR,
        realised=REALISED_COLOUR,
        shaped=frames.shaped,
        magnified=None if errors is None else frames.magnified,
        times=f"{frames.magnified:g}",
        largest="" if errors is None else f"{errors:.3g} µm",
        along=len(frames.planned),
        count=len(frames.t),
        step=f"{1e3 * seconds / (len(frames.t) - 1):.3g} ms",
        hold=END_HOLD_TIME,
        data=_data(frames),
    )


def _data(frames: Frames) -> dict[str, Any]:
    """Return the data for the page's script.

    `near` has, for every row in every frame, the nearest limit as index in `names`, and its use per
    mille.
    """
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
        "q": _round_rows(frames.q, frames.units),
        "pose": _round_rows(frames.pose, ("m",) * 3 + ("rad",) * 3),
        "ramp": [[place, parse_colour(colour)] for place, colour in RAMP],
        "plain": NO_LIMIT_COLOUR,
        "views": [_camera(view) for view in VIEWS],
        "filled": FILLED_SHARE,
        "first": first_view(frames).name,
        "middle": frames.box.mean(0).tolist(),
        "half": (np.maximum(np.ptp(frames.box, axis=0), MIN_BOX_SHARE * frames.size) / 2).tolist(),
    }


def _round_rows(values: Array, units: Sequence[str]) -> list[list[float]]:
    """Rows in mm and degrees, to a thousandth."""
    factors = [SCALES["human"][unit][1] for unit in units]
    rows: list[list[float]] = (np.round(values * factors, 3) + 0.0).tolist()  # no −0
    return rows


def first_view(frames: Frames) -> View:
    """Return the view in space, which is from above for a flat machine."""
    return next(view for view in VIEWS if view.parallel is frames.flat)


def _camera(view: View) -> dict[str, Any]:
    """Return the directions of a view: towards the camera, right and up in its picture.

    The page knows the size of its window: it puts the camera where the whole scene fits next to the
    legend.
    """
    right = view.right / np.linalg.norm(view.right)
    return {
        "name": view.name,
        "up": view.up.tolist(),
        "axes": [axis.tolist() for axis in (right, np.cross(view.back, right), view.back)],
        "fov": radians(AXIS_VIEW_ANGLE if view.parallel else SPACE_VIEW_ANGLE),
    }
