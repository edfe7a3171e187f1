"""How an animation and its still images look: the four views, and the colours of a limit's use."""

from dataclasses import dataclass

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array

RAMP = ((0.0, "#B4C0CA"), (0.5, "#56B4E9"), (0.8, "#E69F00"), (1.0, "#C8102E"))
"""Share of a limit and its colour, straight between: ever darker, so that it reads without hue too."""
NO_LIMIT_COLOUR = "#3C464E"
"""What no limit colours."""
PLANNED_COLOUR, REALISED_COLOUR = "#1B1B1B", "#009E73"
"""The two paths."""


@dataclass(frozen=True, slots=True)
class View:
    """From where one looks: towards the machine against `back`, with `up` upwards; both unit vectors, base frame."""

    name: str
    back: Array
    up: Array
    parallel: bool = True

    @property
    def right(self) -> Array:
        return np.cross(self.up, self.back)


def _view(name: str, back: tuple[float, ...], up: tuple[float, ...], parallel: bool = True) -> View:
    return View(name, freeze_array(np.array(back) / np.linalg.norm(back)), freeze_array(up), parallel)


VIEWS = (
    _view("top", (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
    _view("front", (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    _view("side", (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    _view("3-D", (1.0, -1.5, 0.9), (0.0, 0.0, 1.0), parallel=False),
)


def colour_uses(use: Array) -> np.ndarray:
    """(…, 3) uint8 colours of shares of a limit; NaN, where there is none, is plain."""
    shares = np.clip(use, 0.0, 1.0)
    places = [place for place, _ in RAMP]
    stops = np.array([parse_colour(colour) for _, colour in RAMP])
    mixed = np.stack([np.interp(np.nan_to_num(shares), places, channel) for channel in stops.T], -1)
    return np.where(np.isnan(use)[..., None], parse_colour(NO_LIMIT_COLOUR), np.rint(mixed)).astype(np.uint8)


def parse_colour(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of "#RRGGBB"."""
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return red, green, blue
