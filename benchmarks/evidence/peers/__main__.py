"""Every case by every peer: the table to stdout, as CSV and as a figure."""

import csv
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.evidence.peers.case import (
    Case,
    PeerAnswer,
    circle,
    solve_by_copp,
    solve_by_ipopt,
    solve_by_ruckig,
    solve_certified,
    solve_general,
    solve_order2,
    spline,
    straight_case,
)
from benchmarks.evidence.peers.page import ANSWER_HEADER, cells, verdicts
from benchmarks.evidence.published.compared import markdown

MARKS = {
    "ours": ("o", "C0"), "toppra": ("s", "C1"), "copp-py": ("^", "C2"), "ruckig": ("D", "C3"), "IPOPT": ("x", "C4"),
}  # fmt: skip


def collect_answers() -> Iterator[PeerAnswer]:
    for case in (circle(), spline()):
        yield from _solve_curved(case)
    case = straight_case()
    yield solve_certified(case, 3)
    yield solve_general(case)
    yield from solve_by_ruckig(case)


def _solve_curved(case: Case) -> Iterator[PeerAnswer]:
    yield solve_certified(case, 2)
    yield from solve_order2(case)
    yield from solve_by_copp(case, 2)
    yield solve_certified(case, 3)
    yield solve_by_ipopt(case)
    yield from solve_by_copp(case, 3)


def draw_figure(found: Sequence[PeerAnswer], path: Path) -> None:
    """Duration above the best of its case and order, over wall time."""
    from matplotlib import pyplot as plt

    groups = list(dict.fromkeys((a.case, a.order) for a in found))
    drawn, axes = plt.subplots(1, len(groups), figsize=(3.4 * len(groups), 3.6), layout="constrained")
    for ax, (case, order) in zip(axes, groups, strict=True):
        rows = [a for a in found if (a.case, a.order) == (case, order) and a.feasible == a.feasible]
        best = min(a.feasible for a in rows)
        for kind, (marker, colour) in MARKS.items():
            of = [a for a in rows if a.method.startswith(kind)]
            if of:
                ax.plot(
                    [a.again for a in of],
                    [100 * (a.feasible / best - 1) + 1e-4 for a in of],
                    marker,
                    color=colour,
                    label=kind,
                    alpha=0.8,
                )
        ax.set(xscale="log", yscale="log", title=f"{case}, order {order}", xlabel="wall time (s)")
        ax.title.set_fontsize(9)
        ax.legend(fontsize=7)
    axes[0].set_ylabel("slowed to hold: above the best (%, +1e-4)")
    path.parent.mkdir(parents=True, exist_ok=True)
    drawn.savefig(path, dpi=110)
    plt.close(drawn)


def main() -> None:
    parser = ArgumentParser(prog="python -m benchmarks.evidence.peers", description=__doc__)
    parser.add_argument("--csv", type=Path, default=Path("docs/peers.csv"))
    parser.add_argument("--figure", type=Path, default=Path("docs/images/peers.png"))
    asked = parser.parse_args()
    found = list(collect_answers())
    print(markdown(ANSWER_HEADER, map(cells, found)))
    print(*verdicts(found), sep="\n")
    asked.csv.parent.mkdir(parents=True, exist_ok=True)
    with asked.csv.open("w", newline="") as file:
        csv.writer(file).writerows([ANSWER_HEADER, *map(cells, found)])
    draw_figure(found, asked.figure)


if __name__ == "__main__":
    main()
