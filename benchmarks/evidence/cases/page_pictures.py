"""Pictures of every page for the documentation.

Makes a plan, a plan in parts, a comparison, a calibration and the studio with the commands, opens
each page in Chromium at several widths, light, dark and as printed, and puts the windows side by
side on one sheet per page.
"""

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image, ImageOps

from benchmarks.evidence.table import Row, Table
from kinematics.foundation.errors import MotionError

STUDIO = "studio"
COMMANDS = {
    "report": "plan circle --machine hexapod",
    "parts": "plan circle --machine hexapod --stream",
    "gains": "compare servo-rig --law 1 --law 3 --law 6 --law 6r --law 4 --law ff",
    "calibration": "calibrate hexapod cmm",
}
"""Pages, and the commands that make them. The studio shows all of them, and compares two plans."""
CALM = "plan circle --machine hexapod --duration 20s"

VIEWS = ((1400, "light"), (1400, "dark"), (800, "light"), (390, "light"), (390, "dark"))
"""Pixels of a window, and its colours."""
PORTRAIT, LANDSCAPE = 794, 1123
"""Pixels of A4."""
HEIGHT = 1200
"""Pixels of every window."""
SCALE, GAP, COLOURS = 0.4, 12, 64
"""On a sheet: size of windows, pixels between them, colours of the palette."""
WAIT = 6000
"""ms until a picture is taken: figures are drawn by then."""
PAPER = {"light": "#fff", "dark": "#14181c"}
FRAME = (
    '<!DOCTYPE html><meta name="color-scheme" content="{scheme}"><body style="margin: 0; background: {paper}">'
    '<iframe src="{url}" style="border: 0; width: {width}px; height: {height}px; color-scheme: {scheme}"></iframe>'
)
"""A frame can be as narrow as a phone, which a window of Chromium cannot, and has colours of its own."""


@dataclass(frozen=True, slots=True)
class View:
    """A page in a window of some width (pixels)."""

    url: str
    width: int
    scheme: str


def measure(
    page: str | None = None,
    folder: Path = Path("docs/images/pages"),
) -> Iterator[Table]:
    """Yield the sheets as they are written: that of one page, or of all."""
    names = [*COMMANDS, STUDIO]
    if page is not None:
        if page not in names:
            raise MotionError(f"no page is named {page!r}; give one of {', '.join(names)}")
        names = [page]
    yield Table("Pictures of pages", ("file", "size (kB)"), take_pictures(names, folder))


def take_pictures(names: list[str], folder: Path) -> Iterator[Row]:
    """Write a sheet for each page into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as place:
        plans = Path(place) / "plans"
        commands = COMMANDS | {"calm": CALM}
        for name in commands if STUDIO in names else names:
            command = ["pulsepath", *commands[name].split(), "--out", str(plans / name), "-q"]
            run([sys.executable, "-m", *command])
        for name in names:
            with open_page(name, plans) as views:
                pictures = [take_picture(view, Path(place)) for view in views]
            sheet = folder / f"{name}.png"
            compose(pictures).save(sheet, optimize=True)
            yield [str(sheet), sheet.stat().st_size / 1e3]


def run(command: list[str]) -> None:
    """Run a command, as users run it."""
    subprocess.run(command, check=True, capture_output=True, timeout=600)


@contextmanager
def open_page(name: str, plans: Path) -> Iterator[list[View]]:
    """Return the views of a report, the last of which is as printed, or of the studio while it runs."""
    if name == STUDIO:
        with serve_studio(plans) as address:
            url = f"{address}compare?left=report&right=calm"
            yield [View(url, *view) for view in VIEWS]
        return
    report = plans / name / "report.html"
    text = report.read_text(encoding="utf-8")
    # a screen shows the style of print once the names of the media are exchanged
    printed = text.replace("@media print", "@media all").replace("@media screen", "@media speech")
    paper = report.with_name("printed.html")
    padded = re.sub("<body", '<body style="padding: 45px"', printed, count=1)
    paper.write_text(padded, encoding="utf-8")
    width = LANDSCAPE if "landscape" in text else PORTRAIT
    views = [View(report.as_uri(), *view) for view in VIEWS]
    yield [*views, View(paper.as_uri(), width, "light")]


@contextmanager
def serve_studio(plans: Path) -> Iterator[str]:
    """Run the studio and return its address."""
    command = [sys.executable, "-m", "pulsepath", STUDIO, str(plans), "--no-browser"]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as studio:
        try:
            assert studio.stdout is not None
            addresses = (re.search(r"http://\S+", line) for line in studio.stdout)
            yield next(address[0] for address in addresses if address)
        finally:
            studio.terminate()


def take_picture(view: View, folder: Path) -> Image.Image:
    """Return the picture of a window. Raises MotionError where there is no Chromium."""
    names = ("chromium", "chromium-browser", "google-chrome")
    browser = next(filter(None, map(shutil.which, names)), None)
    if browser is None:
        raise MotionError("no Chromium is in PATH; install one")
    frame, picture = folder / "frame.html", folder / "picture.png"
    html = FRAME.format(
        scheme=view.scheme,
        paper=PAPER[view.scheme],
        url=view.url,
        width=view.width,
        height=HEIGHT,
    )
    frame.write_text(html, encoding="utf-8")
    run(
        [
            browser,
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            f"--window-size={view.width},{HEIGHT + 200}",
            f"--user-data-dir={folder / 'profile'}",
            f"--timeout={WAIT}",
            f"--screenshot={picture}",
            frame.as_uri(),
        ]
    )
    with Image.open(picture) as taken:
        return taken.convert("RGB").crop((0, 0, view.width, HEIGHT))


def compose(pictures: list[Image.Image]) -> Image.Image:
    """Return the pictures side by side, smaller, with a palette."""
    small = [ImageOps.scale(one, SCALE, Image.Resampling.LANCZOS) for one in pictures]
    framed = [np.asarray(ImageOps.expand(one, GAP // 2, "#9aa4ae")) for one in small]
    sheet = ImageOps.expand(Image.fromarray(np.hstack(framed)), GAP // 2, "#9aa4ae")
    return sheet.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
