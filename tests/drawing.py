"""Figures of reports as one dot, for tests that do not look at them."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest

from benchmarks.reports.page import Picture
from benchmarks.reports.time_series import read_panels

REPORTS = ("plan_figures", "window_figures", "calibration_report", "gain.run_figures")
DOT = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108000000003a"
    "7e9b550000000a49444154789c63f80f0001010100b138f6140000000049"
    "454e44ae426082"
)
"""A PNG image of one dot."""


@contextmanager
def drawing(draw) -> Iterator[None]:
    """Let `draw` draw the figures of reports."""
    with pytest.MonkeyPatch.context() as patch:
        for name in REPORTS:
            patch.setattr(f"benchmarks.reports.{name}.draw_figure", draw)
        yield


def draw_dots() -> AbstractContextManager[None]:
    """Draw a dot for each figure of a report; a page still gets the data that it draws by itself.

    Drawing the figures takes nine tenths of writing a plan.
    """
    return drawing(lambda *axes, small=False: Picture(DOT, read_panels(axes)))
