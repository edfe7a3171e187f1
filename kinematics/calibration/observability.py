"""How well the measured poses show the parameters: observability indices, and combinations that they do not show.

From the singular values σ_1 ≥ … ≥ σ_m of the identification Jacobian (errors divided by their noise, by parameters),
its columns scaled to unit length so that units drop out, with N fitted poses:

    O1 = (σ_1 … σ_m)^(1/m) / √N    [Borm and Menq 1991]
    O2 = σ_m / σ_1                 [Driels and Pathre 1990]
    O3 = σ_m                       [Nahvi, Hollerbach and Hayward 1994]
    O4 = σ_m² / σ_1                [Nahvi and Hollerbach 1996]

More is better; all are 0 where a combination of parameters is not shown at all.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table

if TYPE_CHECKING:
    pass

MIN_SINGULAR_SHARE = 1e-9
"""σ / σ_1 below which a combination has no effect: far above the rounding of the Jacobian, below any measurement."""
MIN_NAMED_SHARE = 0.05
"""Share of its largest coefficient from which on a parameter is named in a combination."""


@dataclass(frozen=True, slots=True)
class Observability(Result):
    """singular (m,) σ falling; scale (m,) 1 / length of the columns; combinations (m, m) of scaled columns, in rows."""

    singular: Array
    scale: Array
    combinations: Array
    poses: int

    def tables(self) -> tuple[Table, ...]:
        """The indices: more is better."""
        seen = f"{self.rank} of {len(self.singular)} combinations of parameters seen"
        return (Table(seen, tuple(Column(name, [value], form=".4g") for name, value in self.indices.items())),)

    def data(self) -> Table:
        """The singular value of each combination, the last seen worst."""
        numbered = Column("combination", range(1, len(self.singular) + 1))
        return Table("singular values of the identification Jacobian", (numbered, Column("σ", self.singular)))

    @property
    def rank(self) -> int:
        """How many combinations of parameters the data show."""
        return int((self.singular > MIN_SINGULAR_SHARE * self.singular[0]).sum())

    @property
    def indices(self) -> dict[str, float]:
        """O1 to O4."""
        if self.rank < len(self.singular):
            return dict.fromkeys(("O1", "O2", "O3", "O4"), 0.0)
        first, last = float(self.singular[0]), float(self.singular[-1])
        mean = float(np.exp(np.log(self.singular).mean()))
        return {"O1": mean / self.poses**0.5, "O2": last / first, "O3": last, "O4": last**2 / first}

    @property
    def seen(self) -> Array:
        """(m, rank) changes of the parameters that give independent errors of unit length."""
        kept = slice(0, self.rank)
        return np.asarray(self.scale[:, None] * self.combinations[kept].T / self.singular[kept])

    @property
    def unseen(self) -> Array:
        """(m − rank, m) changes of the parameters, in their own units, that no measured pose shows."""
        return np.asarray(self.combinations[self.rank :] * self.scale)

    @property
    def separate(self) -> np.ndarray:
        """(m,) bool: which parameters take part in no combination that is not shown."""
        return np.asarray(np.abs(self.combinations[self.rank :]).max(0, initial=0.0) < 1e-6)

    @property
    def weakest(self) -> Array:
        """(m,) the least visible change of the parameters, in their own units, as large as its standard error."""
        return np.asarray(self.combinations[-1] * self.scale / self.singular[-1])


def observe(jacobian: Array, poses: int) -> Observability:
    """Observability of a Jacobian (rows ≥ m, m) of errors divided by their noise. Raises MotionError for no numbers."""
    if not np.isfinite(jacobian).all():
        raise MotionError("the identification Jacobian holds no numbers: a pose is singular, or cannot be closed")
    length = np.linalg.norm(jacobian, axis=0)
    scale = np.divide(1.0, length, out=np.ones_like(length), where=length > 0)  # a column of zeros stays one
    _, singular, combinations = np.linalg.svd(jacobian * scale, full_matrices=False)
    return Observability(freeze_array(singular), freeze_array(scale), freeze_array(combinations), poses)


def describe_combination(change: Array, names: Sequence[str]) -> str:
    """A combination in words: its largest parameters with their coefficients, the largest first."""
    share = change / change[np.abs(change).argmax()]  # its sign means nothing
    order = [k for k in np.argsort(-np.abs(share), kind="stable") if abs(share[k]) >= MIN_NAMED_SHARE]
    text = " ".join(f"{'−' if share[k] < 0 else '+'} {abs(share[k]):.2g}·{names[k]}" for k in order[:8])
    return text.removeprefix("+ ") + (f" and {len(order) - 8} more" if len(order) > 8 else "")
