"""The thesis' findings beside the rig's, as a page: `python -m benchmarks.evidence.thesis [--out docs/findings.md]`.

Every law over its gains under every assumption: two to four minutes on one core.
"""

from benchmarks.evidence.published import compared as markdown_page
from benchmarks.evidence.thesis.outcome import assumptions, run_laws
from benchmarks.evidence.thesis.page import page

if __name__ == "__main__":
    markdown_page.run(str(__doc__), lambda: page([run_laws(assumption) for assumption in assumptions()]))
