"""Numbers and names of axes in space: none lies upon another, whatever the shape of what is
drawn.
"""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from kinematics.foundation.figure import label_space

SHAPES = [
    (320, 320, 260),  # a hexapod
    (230, 240, 560),  # tall
    (60, 60, 240),  # a mast
    (100, 20, 20),  # along one axis
    (40, 20, 4),
    (360, 190, 0.4),  # flat
    (500, 280, 540),
    (1200, 1200, 1900),
]
VIEWS = {"a path": (30, -60), "a machine": (26.5, -56.3)}


def lay_out(text, renderer):
    """Centre, turn, half-sizes and points of the box that a text fills; names of axes are
    turned.
    """
    turn = np.deg2rad(text.get_rotation())
    middle = np.mean(text.get_window_extent(renderer).get_points(), axis=0)
    turned = text.get_rotation()
    text.set_rotation(0)
    half = np.ptp(text.get_window_extent(renderer).get_points(), axis=0) / 2
    text.set_rotation(turned)
    frame = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 5)), -1).reshape(-1, 2)
    return middle, frame, half, middle + (grid * half) @ frame.T


def find_overlaps(ax, renderer):
    texts = []
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        low, high = sorted(axis.get_view_interval())
        texts += [tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
        texts += [axis.label] if axis.label.get_text() else []
    boxes = [(text.get_text(), *lay_out(text, renderer)) for text in texts]
    for n, (name, middle, frame, half, points) in enumerate(boxes):
        for other, there, turned, size, corners in boxes[n + 1 :]:
            inside = (
                np.abs((corners - middle) @ frame) < half,
                np.abs((points - there) @ turned) < size,
            )
            if any(each.all(1).any() for each in inside):
                yield name, other


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("size", SHAPES)
def test_no_label_lies_upon_another(size, view):
    figure = Figure(figsize=(4.2, 3.7), layout="constrained")
    ax = figure.add_subplot(projection="3d")
    for name, length in zip("xyz", size, strict=True):
        ax.set(**{f"{name}lim": (-0.4 * length, 0.6 * length)})
    label_space(ax)
    ax.view_init(*VIEWS[view])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    assert not [*find_overlaps(ax, canvas.get_renderer())]
    lengths = np.array([np.ptp(getattr(ax, f"get_{name}lim")()) for name in "xyz"])
    np.testing.assert_allclose(
        ax.get_box_aspect() / np.linalg.norm(ax.get_box_aspect()), lengths / np.linalg.norm(lengths)
    )
