"""The output of `compare`: report, table as JSON, runs as CSV, and the saved runs for later
comparisons.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.files.atomic_files import Destination, stage_files, write_named
from kinematics.foundation.errors import MotionError
from pulsepath.output.directory import CELLS, COMPARISON, COMPARISON_KIND, REPORT

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.reports.gain import Change, Comparison, Judgement

TABLE = "runs.csv"


def destinations(target: Path, force: bool) -> list[Destination]:
    """Write a comparison: report, table and record.

    Raises MotionError unless the folder is empty, has saved runs only, or with `force` another
    comparison.

    Saved runs may stay: each is identified by the hash of its inputs, so that an interrupted
    comparison continues.
    """
    if target.exists() and not target.is_dir():
        raise MotionError(f"{target} exists and is not a directory; give another --out")
    if (target / COMPARISON).exists():
        if not force:
            raise MotionError(
                f"{target} holds a comparison; give another --out, or --force to replace it"
            )
    elif target.exists() and any(target.iterdir()) and not (target / CELLS).is_dir():
        raise MotionError(f"{target} is not empty and holds no saved runs; give another --out")
    return [Destination(target / name, force=True) for name in (REPORT, TABLE, COMPARISON)]


def write(
    to: list[Destination],
    comparison: "Comparison",
    changes: "Sequence[Change]" = (),
    judged: "Sequence[Judgement]" = (),
) -> None:
    """Write everything: all files or none, each whole, the record last.

    changes: against saved runs; judged: by conditions
    """
    from benchmarks.reports.gain.gain_report import comparison_record, gain_report, runs_csv
    from pulsepath.output import record

    verdict, page = gain_report(comparison, changes, judged)
    facts = comparison_record(comparison, verdict, changes, judged)
    text = record.as_json({"schema": record.SCHEMA, "kind": COMPARISON_KIND, **facts})
    to[0].place.parent.mkdir(parents=True, exist_ok=True)
    with stage_files(to) as files:
        for file, content in zip(files, (page, runs_csv(comparison), text), strict=True):
            write_named(file, content)
