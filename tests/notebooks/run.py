"""The notebooks, run: `python -m tests.notebooks.run out/notebooks` writes them with their figures
as .ipynb files.
"""

import sys
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jupyter_client.manager import AsyncKernelManager
    from nbformat import NotebookNode

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.py"))
LONGEST = 60.0
"""s that a cell may take before it is given up."""


def executed(
    path: Path,
    *,
    slower: float = 1.0,
    first: str = "",
    last: str = "",
    kernel: "AsyncKernelManager | None" = None,
) -> "NotebookNode":
    """A notebook after all its cells have run in a kernel of this Python, from the top of this
    source tree.

    first, last: one more cell each, before and behind its own. kernel: one that goes on running
    afterwards; without it, one of its own. Raises CellExecutionError where a cell raises.
    """
    import jupytext
    from nbclient import NotebookClient
    from nbformat.v4 import new_code_cell

    notebook = jupytext.read(path)
    if first:
        notebook.cells.insert(0, new_code_cell(first))
    if last:
        notebook.cells.append(new_code_cell(last))
    client = NotebookClient(
        notebook,
        km=kernel,
        timeout=ceil(LONGEST * slower),
        kernel_name="python3",
        resources={"metadata": {"path": str(ROOT)}},
    )
    client.execute()
    return notebook


def main(folder: Path) -> None:
    """Write every notebook, executed, into a folder."""
    import nbformat

    folder.mkdir(parents=True, exist_ok=True)
    for path in NOTEBOOKS:
        target = folder / f"{path.stem}.ipynb"
        nbformat.write(executed(path), target)
        print(target)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
