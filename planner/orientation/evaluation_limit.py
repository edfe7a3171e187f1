"""An end for a CasADi solver that would not end by itself."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import casadi as ca

from kinematics.files.atomic_files import HeldSignals, defer_signals


class EvaluationLimit(ca.Callback):
    """A zero to add to a constraint: after `most` evaluations, or a Ctrl-C, it is NaN, and the
    solver gives up.

    The solver must take no step for too short (FATROP: alpha_min_frac = 0): else it begins its
    restoration, and there a matrix that is not a number keeps it for ever.
    """

    def __init__(self, most: int) -> None:
        ca.Callback.__init__(self)
        self.most, self.used, self._signals = most, 0, HeldSignals()
        self.construct("patience", {})

    @contextmanager
    def asked(self) -> Iterator[None]:
        """One solve. Ctrl-C ends it at its next evaluation: CasADi would print it and go on."""
        with defer_signals() as signals:
            self.used, self._signals = 0, signals
            yield

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return 1

    def eval(self, arguments: object) -> list[float]:
        self.used += 1
        return [float("nan") if self._signals.came is not None or self.used > self.most else 0.0]

    def has_jacobian(self) -> bool:
        return True

    def get_jacobian(
        self,
        name: str,
        names_in: Sequence[str],
        names_out: Sequence[str],
        options: Mapping[str, Any],
    ) -> ca.Function:
        """Zero, and known to be: an empty matrix."""
        return ca.Function(
            name,
            [ca.MX.sym("x"), ca.MX.sym("out")],
            [ca.MX(1, 1)],
            list(names_in),
            list(names_out),
            options,
        )
