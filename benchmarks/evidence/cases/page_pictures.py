"""Pictures of every report page for the documentation.

The commands make a plan, a plan in parts, a comparison, a calibration and the studio. Chromium
opens each page at several widths, light and dark, and a report also as printed. What a window shows
comes side by side on one sheet for each page. `--page` takes one page only.
"""

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Literal

from benchmarks.evidence.table import Row, Table
from kinematics.foundation.errors import MotionError

if TYPE_CHECKING:
    from PIL.Image import Image

# Width of a window in pixels, and its colour scheme.
VIEWS = ((1400, "light"), (1400, "dark"), (800, "light"), (390, "light"), (390, "dark"))
# Pixels of an A4 sheet, upright and on its side.
PORTRAIT, LANDSCAPE = 794, 1123
# Height of every window in pixels; of a sheet: scale, gap in pixels, and colours of its palette.
HEIGHT, SCALE, GAP, COLOURS = 1200, 0.4, 12, 64
# ms until a picture is taken: figures are drawn by then.
WAIT = 6000
COMMANDS = {
    "report": "plan circle --machine hexapod",
    "parts": "plan circle --machine hexapod --stream",
    "gains": "compare servo-rig --law 1 --law 3 --law 6 --law 6r --law 4 --law ff",
    "calibration": "calibrate hexapod cmm",
}
# A second plan, and the page of the studio that shows both side by side.
CALM = "plan circle --machine hexapod --duration 20s"
STUDIO_PAGE = "compare?left=report&right=calm"
# Chromium has no window as narrow as a phone's, so that a frame holds the page.
FRAME = """\
<!DOCTYPE html><meta name="color-scheme" content="{scheme}"><body style="margin: 0">
<iframe src="{url}" style="border: 0; width: {width}px; height: 1200px; color-scheme: {scheme}"></iframe>
"""


def run(*words: str) -> None:
    """Run the command `pulsepath`, as users do."""
    command = [sys.executable, "-m", "pulsepath", *words]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def write_printed(report: Path) -> tuple[Path, int]:
    """Write a report with its style of print, and return it with the width of its paper."""
    text = report.read_text(encoding="utf-8")
    printed = text.replace("@media print", "@media all").replace("@media screen", "@media speech")
    printed = re.sub("<body", '<body style="padding: 45px"', printed, count=1)
    paper = report.with_name("printed.html")
    paper.write_text(printed, encoding="utf-8")
    return paper, LANDSCAPE if "landscape" in text else PORTRAIT


@contextmanager
def serve_studio(folder: Path) -> Iterator[str]:
    """Serve the studio of a folder, and give the address of its page."""
    command = [sys.executable, "-m", "pulsepath", "studio", str(folder), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            addresses = (re.search(r"http://\S+", line) for line in process.stdout)
            address = next(filter(None, addresses))
            yield address[0] + STUDIO_PAGE
        finally:
            process.terminate()


def shoot(url: str, width: int, scheme: str) -> "Image":
    """Return what a window shows of a page."""
    from PIL import Image  # comes with matplotlib

    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        raise MotionError("no Chromium in PATH: install chromium")
    with TemporaryDirectory() as name:
        folder = Path(name)
        frame, picture = folder / "frame.html", folder / "picture.png"
        frame.write_text(FRAME.format(scheme=scheme, url=url, width=width), encoding="utf-8")
        options = f"--headless=new --no-sandbox --disable-gpu --hide-scrollbars --timeout={WAIT}"
        files = [f"--user-data-dir={folder / 'profile'}", f"--screenshot={picture}"]
        size = f"--window-size={width},{HEIGHT + 200}"
        command = [browser, *options.split(), size, *files, frame.as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
        with Image.open(picture) as taken:
            return taken.convert("RGB").crop((0, 0, width, HEIGHT))


def compose(pictures: "list[Image]", target: Path) -> None:
    """Write the pictures side by side, smaller, with a palette."""
    from PIL import Image, ImageOps

    small = [ImageOps.expand(ImageOps.scale(one, SCALE), GAP, "#9aa4ae") for one in pictures]
    sheet = Image.new("RGB", (sum(one.width for one in small), small[0].height))
    left = 0
    for one in small:
        sheet.paste(one, (left, 0))
        left += one.width
    palette = sheet.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    palette.save(target, optimize=True)


def take_pictures(name: str, plans: Path) -> "list[Image]":
    """Return the pictures of a page; plans: folder for what the commands write."""
    if name == "studio":
        run(*COMMANDS["report"].split(), "--out", str(plans / "report"), "-q")
        run(*CALM.split(), "--out", str(plans / "calm"), "-q")
        with serve_studio(plans) as url:
            return [shoot(url, *view) for view in VIEWS]
    run(*COMMANDS[name].split(), "--out", str(plans / name), "-q")
    report = plans / name / "report.html"
    paper, width = write_printed(report)
    screens = [shoot(report.as_uri(), *view) for view in VIEWS]
    return [*screens, shoot(paper.as_uri(), width, "light")]


def measure(
    page: Literal["all", "report", "parts", "gains", "calibration", "studio"] = "all",
    folder: Path = Path("docs/images/pages"),
) -> Iterator[Table]:
    """Write a sheet for each page into a folder, and yield their sizes."""
    pages = [*COMMANDS, "studio"] if page == "all" else [page]

    def rows() -> Iterator[Row]:
        for name in pages:
            target = folder / f"{name}.png"
            with TemporaryDirectory() as plans:
                compose(take_pictures(name, Path(plans)), target)
            yield [name, target.stat().st_size / 1e3]

    folder.mkdir(parents=True, exist_ok=True)
    yield Table("", ("page", "size (kB)"), rows())
