"""What `compare` leaves behind: the report, its table as JSON, its runs as CSV; and the runs themselves, for later."""

from pathlib import Path

from benchmarks.compare import Comparison, Verdict
from kinematics.errors import MotionError
from kinematics.staging import write_whole

RECORD, KIND = "compare.json", "pulsepath compare"
REPORT, TABLE = "report.html", "runs.csv"


def refuse_overwrite(target: Path, force: bool) -> None:
    """Raise MotionError unless a comparison may be written: nothing there but saved runs, or, with `force`, another.

    Saved runs may stay since each is found by the hash of what it depends on: an interrupted comparison goes on.
    """
    from benchmarks.sweep.store import CELLS

    if target.exists() and not target.is_dir():
        raise MotionError(f"{target} exists and is no directory; give another --out")
    if (target / RECORD).exists():
        if not force:
            raise MotionError(f"{target} holds a comparison; give another --out, or --force to replace it")
    elif target.exists() and any(target.iterdir()) and not (target / CELLS).is_dir():
        raise MotionError(f"{target} is not empty, and holds no saved runs; give another --out")


def write(folder: Path, comparison: Comparison) -> Verdict:
    """Write everything, each file whole or not at all, the record last."""
    from benchmarks.compare.record import of_comparison, runs_csv
    from benchmarks.compare.report import gain_report
    from pulsepath import record

    verdict, page = gain_report(comparison)
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / REPORT, page)
    write_whole(folder / TABLE, runs_csv(comparison))
    text = record.as_json({"schema": record.SCHEMA, "kind": KIND, **of_comparison(comparison, verdict)})
    write_whole(folder / RECORD, text)
    return verdict
