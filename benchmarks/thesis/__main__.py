"""The thesis' findings beside the emulated rig's, as a page: `python -m benchmarks.thesis [--out docs/findings.md]`.

Every law over its gains under every assumption: two to four minutes on one core.
"""

from benchmarks import markdown_page
from benchmarks.thesis.assumptions import assumptions
from benchmarks.thesis.outcome import outcome
from benchmarks.thesis.page import page

if __name__ == "__main__":
    markdown_page.run(str(__doc__), lambda: page([outcome(assumption) for assumption in assumptions()]))
