"""The recorded scene, by viser: the only file that imports it.

A viser server is opened on loopback at a free port while the scene is made, since its scenes belong to servers; nothing
connects to it. What moves goes as positions, turns, lengths and colours of a batch of one cylinder and one of a sphere:
no mesh is sent twice.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.animation.frames import Frames
from benchmarks.animation.look import PLANNED, REALISED, rgb, rgb_of
from benchmarks.animation.nearest import TOOL
from benchmarks.animation.solids import solids
from kinematics.array import Array

if TYPE_CHECKING:
    from viser import SceneApi, ViserServer

HOLD = 0.5
"""s that the last frame stays, before viser's player begins again."""
CLOCK = "/time"
"""A frame without axes whose x is the time of the frame shown, in s: by it the page knows where the player is."""
BALL, AXES = 0.012, 0.12
"""Radius of joints and tool and the length of the base frame's axes, as shares of the size of all that is drawn."""
SKY, SUN = 1.9, 1.0
"""Light from all over, and from aside above."""
SIDES = 16
"""Of the cylinders."""
CELLS = 10
"""Of the grid on the ground, over the size of all that is drawn."""


def recorded(frames: Frames) -> str:
    """The page as viser makes it, its client and the recording in one HTML document; 1 s in it is 1 s of the plan."""
    import trimesh  # comes with viser

    size, bars = frames.size, solids(frames.bars, frames.placed.bars, frames.size)
    tints = rgb(frames.use_of(bars.owners))
    places = np.concatenate([frames.placed.pivots, frames.tool[:, None]], 1)
    marks = rgb(np.concatenate([frames.tilt, frames.use_of([TOOL])], 1))
    rod = trimesh.creation.cylinder(radius=1.0, height=1.0, sections=SIDES)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=BALL * size)
    with _server() as server:
        scene = server.scene
        _surroundings(scene, frames)
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
            rods.batched_positions = _single(bars.centres[k])
            rods.batched_wxyzs = _single(bars.turns[k])
            rods.batched_scales = _single(bars.scales[k])
            rods.batched_colors = tints[k]
            balls.batched_positions = _single(places[k])
            balls.batched_colors = marks[k]
        recording.insert_sleep(HOLD)
        return recording.as_html()


def _surroundings(scene: SceneApi, frames: Frames) -> None:
    """What stands still: the ground, the axes of the base frame, and both paths."""
    size, (low, high) = frames.size, frames.box
    middle = (low + high) / 2
    # viser's own surrounding and lights bleach colours that are to be read
    scene.configure_environment_map(hdri=None)
    scene.configure_default_lights(enabled=False)
    scene.add_light_hemisphere("/light/sky", ground_color=(190, 190, 190), intensity=SKY)
    sun = scene.add_light_directional("/light/sun", intensity=SUN)
    sun.position = middle + size * np.array([1.0, -2.0, 2.0])
    ground = scene.add_grid(
        "/ground", 1.6 * size, 1.6 * size, cell_size=size / CELLS, section_size=size, shadow_opacity=0.0
    )
    ground.position = (float(middle[0]), float(middle[1]), float(low[2] - 0.02 * size))
    scene.add_frame("/base frame", axes_length=AXES * size, axes_radius=AXES * size / 30)
    for name, path, colour, pixels in (
        ("planned", frames.planned, PLANNED, 2.5),
        ("realised", frames.realised, REALISED, 1.5),
    ):
        if path is not None:
            pieces = _single(np.stack([path[:-1], path[1:]], 1))
            scene.add_line_segments(f"/path/{name}", pieces, rgb_of(colour), thickness=pixels, thickness_units="screen")


@contextmanager
def _server() -> Iterator[ViserServer]:
    """A server that says nothing: what it tells, by rich's own console, would stand among the data on stdout."""
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


def _single(values: Array) -> np.ndarray:
    return values.astype(np.float32)
