"""The report of a plan: one HTML page that holds everything it shows, and its figures as PNG files beside it."""

from base64 import b64encode
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from itertools import cycle
from math import ceil, floor, inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from controllers.metrics import Metrics
from planner.classical import Classical
from planner.limits import Limit
from planner.plan import Plan
from planner.pulses import PulseCheck

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from planner.plots import Quantity

DPI = 150


@dataclass(frozen=True, slots=True)
class Findings:
    """All that is told of one plan: the baseline it is compared with, the check of its pulses, the errors of each tracking law."""

    plan: Plan
    classical: Classical
    verdict: PulseCheck
    metrics: tuple[Metrics, ...] = ()
