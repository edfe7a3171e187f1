"""What became of each law in a comparison: its best setting, or why it has none; and what the rig
lets a law do.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from benchmarks.reports.gain.comparison import SAME_RATIO, Comparison, SettingEntry
from benchmarks.sweep import SavedRuns
from controllers.laws.registry import find_law
from kinematics.foundation.names import count_noun

STEPPER = "stepper"
"""What the record of runs calls the drive of an axis, if it has pulses to lose."""
FULL_TORQUE = 1.0
"""Of what a drive can give: a stepper that is asked for more loses steps."""


@dataclass(frozen=True, slots=True)
class LawOutcome:
    """A law in a comparison: of how many settings, how many hold, the best of them, and why the
    others do not.

    best   the baseline too, where it is the best of its law; None where none holds
    faults how many settings each fault strikes out
    """

    law: str
    settings: int
    held: int
    best: SettingEntry | None
    score: float
    faults: Mapping[str, int]

    def describe(self, comparison: Comparison) -> str:
        """ "closed-error: none of 8 settings holds (8 failed or unstable on circle)"."""
        faults = ", ".join(f"{count} {why}" for why, count in self.faults.items())
        if self.best is None:
            holds = (
                "its setting does not hold"
                if self.settings == 1
                else f"none of {self.settings} settings holds"
            )
            return f"{self.law}: {holds} ({faults})"
        of = "" if self.settings == 1 else f", best of {self.settings}"
        left = f" ({faults})" if faults else ""
        baseline = " (baseline)" if self.best == comparison.baseline else ""
        return f"{comparison.label(self.best)}{baseline}: {self.score:.3g}{of}{left}"


def find_outcomes(comparison: Comparison) -> list[LawOutcome]:
    """Of every law that was run, those that hold first, the best first."""
    ranked, base = comparison.rank(), comparison.baseline
    found = []
    for law in dict.fromkeys(entry.setting.law for entry in comparison.entries):
        own = [entry for entry in comparison.entries if entry.setting.law == law]
        held = [entry for entry in ranked if entry.setting.law == law]
        faults = Counter(why for entry in own if (why := comparison.fault(entry)))
        score = {entry: comparison.score(entry) for entry in held}
        if base in own and not comparison.fault(base):
            score[base] = 1.0
        best = min(score, key=score.__getitem__, default=None)
        if best is not None and base in score and score[best] >= 1 - SAME_RATIO:
            best = base
        found.append(
            LawOutcome(
                law, len(own), len(score), best, inf if best is None else score[best], faults
            )
        )
    return sorted(found, key=lambda one: one.score)


def describe_outcomes(comparison: Comparison) -> list[str]:
    """A sentence on every law, where there are several."""
    outcomes = find_outcomes(comparison)
    if len(outcomes) < 2 or not comparison.ranked:
        return []
    return [f"Law by law, weighed: {'; '.join(one.describe(comparison) for one in outcomes)}."]


def outcome_record(one: LawOutcome) -> dict[str, Any]:
    """As plain data; null where no setting holds."""
    return {
        "law": one.law,
        "settings": one.settings,
        "hold": one.held,
        "best": None if one.best is None else dict(one.best.setting.gains),
        "score": None if one.best is None else one.score,
        "left_out": dict(one.faults),
    }


def describe_feedback(comparison: Comparison) -> list[str]:
    """That laws which close a loop were run where there is nothing to close it by."""
    laws = list(dict.fromkeys(entry.setting.law for entry in comparison.entries))
    blind = [
        source
        for source in comparison.sources
        if not all(drive["encoder"] for drive in _list_drives(source))
    ]
    return describe_blind(laws, list(dict.fromkeys(source.record["rig"] for source in blind)))


def describe_blind(laws: Sequence[str], rigs: Sequence[str]) -> list[str]:
    """The same of laws by name, on rigs some of whose drives have no encoder."""
    closed = [law for law in laws if getattr(find_law(law), "reads_encoder", False)]
    if not closed or not rigs:
        return []
    whose = "closes its loop" if len(closed) == 1 else "close their loops"
    told = f"{', '.join(closed)} {whose} over the pulses that were sent, so that no error of the drives is corrected"
    return [f"No encoder is read on {', '.join(rigs)}: {told}."]


def describe_overload(comparison: Comparison, entry: SettingEntry) -> list[str]:
    """That a setting asks steppers for more torque than they have, which loses steps."""
    if not any(
        drive["kind"] == STEPPER for drive in _list_drives(comparison.sources[entry.source])
    ):
        return []
    runs = [one for row in comparison.of(entry) for one in comparison.runs(entry, row.task)]
    over = [one for one in runs if one.figures.get("torque_peak", 0.0) > FULL_TORQUE]
    if not over:
        return []
    worst = max(over, key=lambda one: one.figures["torque_peak"])
    lost = max(one.figures.get("lost_steps", 0.0) for one in over)
    kept = (
        f"{lost:g} full steps were lost here"
        if lost
        else "none was lost here, and a real one has less in hand"
    )
    return [
        f"WARNING: it takes up to {100 * worst.figures['torque_peak']:.3g} % of the torque of its steppers, on "
        f"{worst.cell.task} ({worst.cell.variation.name}), more than they have in {len(over)} of "
        f"{count_noun(len(runs), 'run')}. Beyond its torque a stepper loses steps ({kept}): run the path more slowly, "
        "or take stronger motors."
    ]


def _list_drives(source: SavedRuns) -> list[Mapping[str, Any]]:
    """None of runs that were saved before drives were recorded."""
    return [*source.record.get("drives", {}).values()]
