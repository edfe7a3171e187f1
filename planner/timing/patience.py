"""An end to a solve that would not end by itself."""

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca


class Patience(ca.Callback):
    """A zero to add to a constraint: after `most` evaluations it is NaN instead, and the solver gives up.

    FATROP's restoration phase knows no limit of its own and can go on for hours.
    """

    def __init__(self, most: int) -> None:
        ca.Callback.__init__(self)
        self.most, self.used = most, 0
        self.construct("patience", {})

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return 1

    def eval(self, arguments: object) -> list[float]:
        self.used += 1
        return [0.0 if self.used <= self.most else float("nan")]

    def has_jacobian(self) -> bool:
        return True

    def get_jacobian(
        self, name: str, names_in: Sequence[str], names_out: Sequence[str], options: Mapping[str, Any]
    ) -> ca.Function:
        """Zero, and known to be: an empty matrix."""
        return ca.Function(
            name, [ca.MX.sym("x"), ca.MX.sym("out")], [ca.MX(1, 1)], list(names_in), list(names_out), options
        )
