"""The thesis' findings beside the emulated rig's, as a page: `python -m benchmarks.thesis [--out docs/findings.md]`.

Ten laws over their gains under sixteen assumptions: about three minutes on one core.
"""

import argparse
from pathlib import Path

from benchmarks.thesis.assumptions import assumptions
from benchmarks.thesis.outcome import outcome
from benchmarks.thesis.page import page


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="write the page here; printed by default")
    out = parser.parse_args().out
    text = page([outcome(assumption) for assumption in assumptions()])
    if out is None:
        print(text, end="")
        return
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        parser.error(f"cannot write {out}: {error.strerror}")


if __name__ == "__main__":
    main()
