"""The tracking laws on the servo rig: RMS contour errors of each at its best gain on one line.

The gains of a law are swept over its own grid on the path `line`, and those with the least error
are taken. With them the law runs the other paths, and all paths with inertia and friction 30 % more
and less, in all four combinations, of which the worst is listed. Torques are shares of the limit of
the worst axis, on the line. `ff-` and `mpc-` know neither the play of the gears nor the friction of
the motors. The table that is learned in `--trials` trials is valid for its path only; the
feedforward that is fitted to it is for any path.
"""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from benchmarks.evidence.learning import fit_feedforward, learn
from benchmarks.evidence.table import Table
from controllers.laws.law import AnyLaw
from controllers.laws.nominal import nominal_axes
from controllers.laws.open_loop import Feedforward
from controllers.laws.registry import LAWS, find_law
from controllers.metrics.evaluate import evaluate_runs
from controllers.metrics.metrics import Metrics
from controllers.rig import Rig, Task, disturb_rig
from controllers.rig_file import load_rig
from controllers.simulate import sample, simulate
from kinematics.foundation.arrays import Array

PATHS = ("line", "circle", "circle-back", "square")
"""The first is that on which gains are chosen."""
DISTURBANCES = (0.7, 1.3)
"""Factors of inertia and of friction."""
UNINFORMED = {"ff": {"play": 0.0}, "mpc": {"play": 0.0, "friction": 0.0}}
ERRORS = (*(f"{path} (µm)" for path in PATHS), *(f"{path} ±30 % (µm)" for path in PATHS))


def measure(trials: int = 8) -> Iterator[Table]:
    """Yield the errors of all laws, and those of the best published law divided by ours."""
    rig = load_rig("servo-rig")
    laws = {number: tune_law(number, rig) for number, _ in LAWS}
    laws |= {f"{number}-": find_law(number, rig, **gains) for number, gains in UNINFORMED.items()}
    rows = {number: measure_law(law, rig) for number, law in laws.items()}
    columns = ("law", *ERRORS, "torque RMS", "torque peak")
    yield Table("Laws", columns, [(name, *row) for name, row in rows.items()])

    published = np.array([rows[number] for number in "1234567"])
    ours = {name: row for name, row in rows.items() if name.rstrip("-") in UNINFORMED}
    cuts = [(name, *find_cut(published, row)) for name, row in ours.items()]
    yield Table("Error of the best published law, divided by ours", ("law", *ERRORS), cuts)

    table, fitted = learn_laws(rig, trials)
    names = ("law", "line (µm)", "circle (µm)")
    learned = measure_law(table, rig, PATHS[:1])
    model = measure_law(fitted, rig, PATHS[:2])
    rows_learned = [("learned", learned[0], None), ("fitted", *model[:2])]
    yield Table(f"Laws of {trials} trials", names, rows_learned)


def tune_law(number: str, rig: Rig) -> AnyLaw:
    """Return the law at the gains of its grid with the least error on the first path."""
    grid = find_law(number).grid
    cells = np.array(list(product(*grid.values())))
    gains = dict(zip(grid, cells.T[:, :, None], strict=True))
    runs = run_law(find_law(number, rig, **gains), rig.task(PATHS[0]), [rig] * len(cells))
    best = cells[np.argmin([metrics.contour.rms for metrics in runs])]
    return find_law(number, rig, **dict(zip(grid, best.tolist(), strict=True)))


def run_law(law: AnyLaw, task: Task, rigs: Sequence[Rig]) -> tuple[Metrics, ...]:
    """Run a law on a task, on several rigs."""
    runs = simulate(sample(task.motion, rigs[0].machine, task.dt), law, rigs, period=1e-3)
    return evaluate_runs(runs, task, rigs)


def measure_law(
    law: AnyLaw,
    rig: Rig,
    paths: Sequence[str] = PATHS,
    disturbances: Sequence[float] = DISTURBANCES,
) -> Array:
    """Return the errors (µm) on paths, the worst ones on disturbed rigs, and the torques."""
    pairs = product(disturbances, disturbances)
    rigs = [
        rig,
        *(disturb_rig(rig, inertia=inertia, friction=friction) for inertia, friction in pairs),
    ]
    runs = [run_law(law, rig.task(path), rigs) for path in paths]
    errors = 1e6 * np.array([[metrics.contour.rms for metrics in each] for each in runs])
    figures = runs[0][0].figures()
    torques = figures["torque_rms"], figures["torque_peak"]
    return np.array([*errors[:, 0], *errors[:, 1:].max(1), *torques])


def find_cut(published: Array, ours: Array) -> Array:
    """Return the least error of published laws (N, C) divided by ours (C,), without the torques."""
    return np.asarray(published.min(0)[:-2] / ours[:-2])


def learn_laws(rig: Rig, trials: int) -> tuple[AnyLaw, AnyLaw]:
    """Return the table of commands learned on the first path, and the feedforward nearest to it."""
    task = rig.task(PATHS[0])
    table = learn(rig, task, trials).best
    reference = sample(task.motion, rig.machine, task.dt)
    return table, Feedforward(axes=fit_feedforward(reference, table, nominal_axes(rig)))
