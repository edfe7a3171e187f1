"""The legends of the report: within their figures, whatever their names."""

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from benchmarks.reports import plan_figures
from benchmarks.reports.page import NARROW


@pytest.mark.parametrize("axis", ["Z", "shoulder"])
def test_the_legend_of_what_limits_are_worth_is_within_its_figure(axis):
    above, ax = plan_figures._stack_axes(2, 3.2, share=False, width=NARROW)
    above.barh(["tool speed", "acceleration, all axes"], [400, 1])
    for name in (
        "tool speed",
        f"acceleration, {axis}",
        "jerk, Z",
        "speed, X",
        f"acceleration, {axis} ",
        "others",
    ):
        ax.stairs([2000.0], [0.0, 800.0], label=name)
    ax.set_ylabel("µs saved per mm by one per cent")
    legend = plan_figures._add_legend(ax, 3).get_legend()
    figure = ax.get_figure(root=True)
    FigureCanvasAgg(figure).draw()
    box = legend.get_window_extent()
    assert 0 <= box.x0 < box.x1 <= figure.bbox.width
    assert legend.get_window_extent().y0 >= ax.get_window_extent().y1 - 1
