"""The command of a page in Markdown: printed, or written to a file."""

import argparse
from collections.abc import Callable
from pathlib import Path


def run(about: str, page: Callable[[], str]) -> None:
    """Print what `page` makes, or write it where --out says; about: the command's help."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="write the page here; printed by default")
    out = parser.parse_args().out
    text = page()
    if out is None:
        print(text, end="")
        return
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        parser.error(f"cannot write {out}: {error.strerror}")
