"""Still images for papers: a machine at one instant of a plan, from above, in front, aside and in
space.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.animation.frames import (
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
)
from kinematics.files.atomic_files import Destination, require_folder
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import check_arguments
from kinematics.machine.kind import Sort

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTHS: dict[Sort, float] = {"frame": 1.4, "actuator": 2.6, "link": 3.4, "platform": 2.0}
"""Points."""
USE, TILT_LABEL = "use of the nearest limit", "; joints: of their tilt"
FORMATS = (".pdf", ".png", ".svg")
DPI, LIMITS_PER_LINE = 200, 4
FLAT_HEIGHT_SHARE = 1e-3
"""Share of a flat machine's size that is drawn above and below it in space."""


@check_arguments()
def save_four_views(
    plan: AnimatablePlan,
    path: str | Path,
    t: float | None = None,
    *,
    magnify: float | None = None,
    force: bool = False,
) -> Path:
    """Write `four_views` to a file.

    Parameters
    ----------
    plan
        As of `four_views`.
    path
        Whose suffix is .pdf, .png or .svg.
    t, magnify
        As of `four_views`.
    force
        Replace a file that is there.

    Returns
    -------
    Path
        Of the file.

    Raises
    ------
    MotionError
        The file exists, its folder does not, or the suffix is another.
    """
    require_folder(f"views {path}", Path(path))
    target = Destination(Path(path), force=force, remedy="give force=True to replace it")
    write_four_views(plan, target, t, magnify)
    return target.path


def write_four_views(
    plan: AnimatablePlan, target: Destination, t: float | None, magnify: float | None
) -> None:
    """Write `four_views` to a file. Raises MotionError for one that no still image can be."""
    if target.path.suffix.lower() not in FORMATS:
        raise MotionError(
            f"{target.path}: still images are {', '.join(FORMATS)}; give a name that ends so"
        )
    figure = four_views(plan, t, magnify=magnify)[0].get_figure(root=True)
    with target.stage() as file:
        if figure is not None:
            figure.savefig(file, dpi=DPI)


@check_arguments()
def four_views(
    plan: AnimatablePlan, t: float | None = None, *, magnify: float | None = None
) -> "tuple[Axes, ...]":
    """Draw the views top, front, side and 3-D in one figure with equal scales, in base-frame
    coordinates.

    Parameters
    ----------
    plan
        What `plan` or `load_plan` gave.
    t
        s from the start. None: half of the motion.
    magnify
        As in `animate`.

    Returns
    -------
    tuple
        The axes of the four views.

    Raises
    ------
    MotionError
        t is out of the motion.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure

    duration = plan.trajectory.duration
    when = duration / 2 if t is None else float(t)
    if not 0 <= when <= duration:
        raise MotionError(
            f"t = {when:.6g} s is not within the motion, which lasts from 0 to {duration:.6g} s"
        )
    frames = compute_frames(plan, np.array([when]), magnify)
    figure = Figure(figsize=(9, 8), layout="constrained")
    axes = tuple(
        figure.add_subplot(2, 2, n, **({} if view.parallel else {"projection": "3d"}))
        for n, view in enumerate(VIEWS, 1)
    )
    for ax, view in zip(axes, VIEWS, strict=True):
        _draw(ax, frames, view)
    ramp = LinearSegmentedColormap.from_list("use", RAMP)
    bar = figure.colorbar(
        ScalarMappable(cmap=ramp),
        ax=list(axes),
        shrink=0.5,
        aspect=30,
        label=USE + TILT_LABEL * bool(np.isfinite(frames.tilt).any()),
    )
    bar.set_ticks([0, 0.25, 0.5, 0.75, 1], labels=["0", "25 %", "50 %", "75 %", "100 %"])
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    title = f"{frames.program} on {frames.machine} at {when:.3f} s\n{_describe_limits(frames)}"
    figure.suptitle(title, fontsize="small", parse_math=False)  # names are no formulas
    return axes


def _draw(ax: Any, frames: Frames, view: View) -> None:
    """Draw one view in mm: bars from the farthest to the nearest, joints, the tool and both
    paths.
    """
    from kinematics.foundation.figure import label_space

    shown = _plane(view) if view.parallel else np.eye(3)
    colours = colour_uses(frames.use_of([bar.axis for bar in frames.bars])[0]) / 255
    marks = colour_uses(np.append(frames.tilt[0], frames.use_of([TOOL])[0])) / 255
    depth = frames.placed.bars[0].mean(1) @ view.back
    for k in np.argsort(depth):
        ax.plot(
            *(1e3 * frames.placed.bars[0, k] @ shown).T,
            color=colours[k],
            linewidth=WIDTHS[frames.bars[k].sort],
            solid_capstyle="round",
        )
    pivots = 1e3 * frames.placed.pivots[0] @ shown
    flat = {} if view.parallel else {"depthshade": False}
    ax.scatter(
        *pivots.T, s=22, color=marks[:-1], edgecolor="white", linewidth=0.5, zorder=3, **flat
    )
    if frames.realised is not None:
        ax.plot(
            *(1e3 * frames.realised @ shown).T,
            color=REALISED_COLOUR,
            linewidth=0.7,
            zorder=4,
            label=_path(frames),
        )
    ax.plot(
        *(1e3 * frames.planned @ shown).T,
        color=PLANNED_COLOUR,
        linewidth=0.7,
        zorder=5,
        label="path planned",
    )
    ax.scatter(
        *(1e3 * frames.tool[:1] @ shown).T,
        s=30,
        color=marks[-1:],
        edgecolor="black",
        zorder=6,
        label="tool",
        **flat,
    )
    ax.set_title(view.name)
    if not view.parallel and frames.flat:  # matplotlib's own room for no height at all is in mm
        height = 1e3 * frames.box[0, 2]
        ax.set(
            zlim=height + 1e3 * FLAT_HEIGHT_SHARE * frames.size * np.array([-1, 1]), zticks=[height]
        )
    ax.set_aspect("equal", **({"adjustable": "datalim"} if view.parallel else {}))
    if view.parallel:
        for way, axis in zip("xy", shown.T, strict=True):
            ax.set(**{f"{way}label": f"{'xyz'[int(np.argmax(axis))]} (mm)"})
    else:
        label_space(ax)
        x, y, z = view.back
        ax.view_init(elev=np.rad2deg(np.arcsin(z)), azim=np.rad2deg(np.arctan2(y, x)))


def _plane(view: View) -> Array:
    """Return the (3, 2) matrix that projects points into the picture."""
    return np.stack([view.right, view.up], 1)


def _path(frames: Frames) -> str:
    named = (
        "path of the pulses, behind the input shapers" if frames.shaped else "path of the pulses"
    )
    return named + ("" if frames.magnified == 1 else f", error × {frames.magnified:g}")


def _describe_limits(frames: Frames) -> str:
    """List the nearest limit of every axis and of the tool, LIMITS_PER_LINE in a line."""
    nearest = frames.nearest
    texts = [
        f"{owner}: {nearest.limits[n]} {100 * use:.0f} %"
        for owner, n, use in zip(nearest.owners, nearest.which[0], nearest.use[0], strict=True)
        if n >= 0  # an axis without limits has none that is nearest
    ]
    lines = [texts[k : k + LIMITS_PER_LINE] for k in range(0, len(texts), LIMITS_PER_LINE)]
    return "\n".join("    ".join(line) for line in lines)
