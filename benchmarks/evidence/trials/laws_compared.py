"""The tracking laws side by side on the servo rig: each at its best gain on the thesis' line, then on what it was not
tuned on.

python -m benchmarks.evidence.trials.laws_compared            # all of it, one to three minutes
python -m benchmarks.evidence.trials.laws_compared --trials 3 # fewer trials of learning

Every law's gains are swept over its own grid on task `line` and the gain of the least RMS contour error is kept. With
it, the law runs the other paths, and the line and the circle once more with inertia and friction 30 % more and less, in
all four combinations, of which the worst is told. Effort is torque over its limit of the worst axis, on the line.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from benchmarks.evidence.learning import Learned, fit_feedforward, learn
from benchmarks.evidence.published.compared import markdown
from controllers.card import Refused
from controllers.laws.law import AnyLaw
from controllers.laws.nominal import nominal_axes
from controllers.laws.open_loop import Feedforward
from controllers.laws.registry import LAWS, find_law
from controllers.metrics.evaluate import evaluate_runs
from controllers.metrics.metrics import Metrics
from controllers.rig import Rig, Task, disturb_rig
from controllers.rig_file import load_rig
from controllers.simulate import sample, simulate

TUNED, SECOND, OTHER_PATHS = "line", "circle", ("circle-back", "square")
"""The path that gains are chosen on, the one that decides what a law keeps, and more."""
DISTURBANCE_FACTORS = (0.7, 1.3)
"""Of inertia and of friction."""

UNINFORMED_GAINS = {"ff": {"play": 0.0}, "mpc": {"play": 0.0, "friction": 0.0}}
"""Our laws on a host that is not told of the gears' play and the motors' friction, which the rig file assumes."""


@dataclass(frozen=True, slots=True)
class LawRow:
    """What one law did; RMS contour errors in m, efforts in shares of the torque limit.

    paths      task -> error on the rig as stated
    disturbed  task -> worst error with other inertia and friction
    """

    number: str
    name: str
    paths: Mapping[str, float]
    disturbed: Mapping[str, float]
    torque_rms: float
    torque_peak: float

    @property
    def is_published(self) -> bool:
        """One of the thesis' seven as tabulated."""
        return self.number in "1234567"

    def cells(self, paths: Sequence[str]) -> list[str]:
        errors = [*(self.paths[path] for path in paths), self.disturbed[TUNED], self.disturbed[SECOND]]
        effort = [f"{self.torque_rms:.3f}", f"{self.torque_peak:.3f}"]
        return [self.number, self.name, *(f"{1e6 * error:.1f}" for error in errors), *effort]


def run_law(law: AnyLaw, task: Task, rigs: Sequence[Rig]) -> tuple[Metrics, ...]:
    """A law on one task, on several rigs."""
    runs = simulate(sample(task.motion, rigs[0].machine, task.dt), law, rigs, period=1e-3)
    return evaluate_runs(runs, task, rigs)


def tune_law(number: str, rig: Rig) -> AnyLaw:
    """The law at the gains of its grid with the least RMS contour error on the tuned path; all gains in one batch."""
    grid = find_law(number).grid
    cells = list(product(*grid.values()))
    if len(cells) == 1:
        return find_law(number, rig)
    columns = {gain: np.array(values)[:, None] for gain, values in zip(grid, zip(*cells, strict=True), strict=True)}
    found = run_law(find_law(number, rig, **columns), rig.task(TUNED), [rig] * len(cells))
    best = cells[int(np.argmin([metrics.contour.rms for metrics in found]))]
    return find_law(number, rig, **dict(zip(grid, best, strict=True)))


def row(
    number: str,
    law: AnyLaw,
    rig: Rig,
    others: Sequence[str] = OTHER_PATHS,
    name: str = "",
    shares: Sequence[float] = DISTURBANCE_FACTORS,
    on: Sequence[str] = (TUNED, SECOND),
) -> LawRow:
    """A law's line of the table; `on`: the paths that it also runs with other inertia and friction."""
    rigs = [
        rig,
        *(disturb_rig(rig, inertia=inertia, friction=friction) for inertia, friction in product(shares, shares)),
    ]
    found = {path: run_law(law, rig.task(path), rigs) for path in on}
    paths = {path: of[0].contour.rms for path, of in found.items()}
    paths |= {path: run_law(law, rig.task(path), [rig])[0].contour.rms for path in others}
    worst = {path: max(metrics.contour.rms for metrics in of[1:]) for path, of in found.items()}
    figures = found[TUNED][0].figures()
    return LawRow(number, name or law.name, paths, worst, figures["torque_rms"], figures["torque_peak"])


def transfer_table(law: Learned, of: Task, to: Task, rig: Rig) -> Learned:
    """A learned table taken to another path: that path, and what the table had added to its own, step by step."""
    here, there = (sample(task.motion, rig.machine, task.dt) for task in (of, to))
    steps = min(here.steps, there.steps)
    position = np.concatenate([there.position, np.repeat(there.position[-1:], 3, axis=0)])
    position[: steps + 1] += law.position[: steps + 1] - here.position[: steps + 1]
    turn = np.zeros((len(position) - 1, position.shape[1]))
    turn[: there.steps] = np.diff(there.speed, axis=0)
    return Learned(position, turn)


def measure_learning(
    rig: Rig, trials: int, others: Sequence[str] = OTHER_PATHS, shares: Sequence[float] = DISTURBANCE_FACTORS
) -> list[LawRow]:
    """Learning on the tuned path; its table played there and taken along, and the model that the table tells."""
    task = rig.task(TUNED)
    learning = learn(rig, task, trials)
    name = f"learned in {trials} trials"
    own = row("ilc", learning.best, rig, (), name, shares, (TUNED,))
    tables = {path: _transferred_error(learning.best, task, rig.task(path), rig) for path in (SECOND, *others)}
    reference = sample(task.motion, rig.machine, task.dt)
    model = Feedforward(axes=fit_feedforward(reference, learning.best, nominal_axes(rig)))
    return [
        replace(own, paths={**own.paths, **tables}, disturbed={**own.disturbed, SECOND: float("nan")}),
        row("ilc+ff", model, rig, others, f"feedforward by what was {name}", shares),
    ]


def error_reductions(ours: LawRow, rows: Sequence[LawRow]) -> dict[str, float]:
    """By how much ours cuts the RMS contour error of the best published law of each column of errors."""
    theirs = [row for row in rows if row.is_published]
    found = {path: min(row.paths[path] for row in theirs) / ours.paths[path] for path in ours.paths}
    rough = {path: min(row.disturbed[path] for row in theirs) / of for path, of in ours.disturbed.items()}
    return found | {f"{path} ±30 %": ratio for path, ratio in rough.items()}


def _transferred_error(law: Learned, of: Task, to: Task, rig: Rig) -> float:
    """inf where the card refuses a speed that the table asks for there."""
    try:
        return run_law(transfer_table(law, of, to, rig), to, [rig])[0].contour.rms
    except Refused:
        return float("inf")


def verdict(rows: Sequence[LawRow]) -> str:
    """The cuts of our laws that need no trials."""
    lines = []
    for ours in (row for row in rows if row.number.rstrip("-") in ("ff", "mpc")):
        parts = ", ".join(f"{column} {ratio:.1f}x" for column, ratio in error_reductions(ours, rows).items())
        lines.append(f"{ours.name}: {parts}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=8)
    trials = parser.parse_args().trials
    rig = load_rig("servo-rig")
    rows = [row(number, tune_law(number, rig), rig) for number, _ in LAWS]
    rows += [row(f"{number}-", find_law(number, rig, **gains), rig) for number, gains in UNINFORMED_GAINS.items()]
    rows += measure_learning(rig, trials)
    paths = (TUNED, SECOND, *OTHER_PATHS)
    header = ("no.", "law at its best gain", *(f"{path}, µm" for path in paths), f"{TUNED} ±30 %, µm",
              f"{SECOND} ±30 %, µm", "torque RMS", "torque peak")  # fmt: skip
    print(markdown(header, (row.cells(paths) for row in rows)))
    print(f"\nThe best published law of each column over ours:\n{verdict(rows)}")


if __name__ == "__main__":
    main()
