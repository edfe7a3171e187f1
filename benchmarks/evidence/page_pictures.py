"""Pictures of every page for the documentation: `python -m benchmarks.evidence.page_pictures`.

Makes a plan, a plan in parts, a comparison, a calibration and the studio with the commands, opens each page in Chromium
at several widths, light, dark and as printed, and puts what a window shows side by side on one sheet per page.
"""

import re
import shutil
import subprocess
import sys
from argparse import ArgumentParser
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from PIL.Image import Image

VIEWS = ((1400, "light"), (1400, "dark"), (800, "light"), (390, "light"), (390, "dark"), (794, "print"))
LANDSCAPE = 1123
"""Pixels of a window, and how the page is shown in it; A4 is 794 pixels wide, and 1123 on its side."""
HEIGHT, SCALE, GAP, COLOURS = 1200, 0.4, 12, 64
"""Pixels of every window; of a sheet: the share of their size, the room between them, the colours of its palette."""
WAIT = 6000
"""ms until a picture is taken: figures are drawn by then."""
COMMANDS = {
    "report": "plan circle --machine hexapod",
    "parts": "plan circle --machine hexapod --stream",
    "gains": "compare servo-rig --law 1 --law 3 --law 6 --law 6r --law 4 --law ff",
    "calibration": "calibrate hexapod cmm",
    "calm": "plan circle --machine hexapod --duration 20s",
}
SHOWN = "compare?left=report&right=calm"
"""What the studio shows side by side."""
FRAME = (
    '<!DOCTYPE html><meta name="color-scheme" content="{scheme}"><body style="margin: 0; background: {paper}">'
    '<iframe src="{url}" style="border: 0; width: {width}px; height: {height}px; color-scheme: {scheme}"></iframe>'
)
"""A window as narrow as a phone, which Chromium has none of, and as dark as asked."""


@dataclass(frozen=True, slots=True)
class Page:
    """url: where a browser finds it; printed: the same laid out as on paper, so wide; "" where nobody prints it."""

    url: str
    printed: str = ""
    wide: int = 0


def main() -> None:
    """Write a sheet per page."""
    asked = ArgumentParser(description=__doc__)
    asked.add_argument("--out", type=Path, default=Path("docs/images/pages"))
    asked.add_argument(
        "pages", nargs="*", metavar="PAGE", help=f"of {', '.join(COMMANDS)}, studio; default: all but calm"
    )
    options = asked.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder:
        names = options.pages or [*(name for name in COMMANDS if name != "calm"), "studio"]
        for name in names if "studio" not in names else COMMANDS:
            run("pulsepath", *COMMANDS[name].split(), "--out", f"{folder}/plans/{name}", "-q")
        for name in names:
            with open_page(name, Path(folder)) as page:
                target = options.out / f"{name}.png"
                compose(
                    [shoot(page, *view, Path(folder)) for view in VIEWS if view[1] != "print" or page.printed], target
                )
                print(f"{target}: {target.stat().st_size / 1e3:.0f} kB")


def run(module: str, *arguments: str) -> None:
    """A module in a process of its own, as users run it."""
    subprocess.run([sys.executable, "-m", module, *arguments], check=True, stdout=subprocess.DEVNULL)


@contextmanager
def open_page(name: str, folder: Path) -> Iterator[Page]:
    """A report as a file, once more with the style of print; or the studio, served as long as it is open."""
    if name != "studio":
        report = folder / "plans" / name / "report.html"
        paper = folder / f"{name}-printed.html"
        text = (
            report.read_text(encoding="utf-8")
            .replace("@media print", "@media all")
            .replace("@media screen", "@media speech")
        )
        paper.write_text(re.sub("<body", '<body style="padding: 45px"', text, count=1), encoding="utf-8")
        yield Page(report.as_uri(), paper.as_uri(), LANDSCAPE if "landscape" in text else VIEWS[-1][0])
        return
    command = [sys.executable, "-m", "pulsepath", "studio", "plans", "--no-browser"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as served:
        try:
            assert served.stdout is not None
            found = next(filter(None, (re.search(r"http://\S+", line) for line in served.stdout)))
            yield Page(found[0] + SHOWN)
        finally:
            served.terminate()


def shoot(page: Page, width: int, look: str, folder: Path) -> "Image":
    """What a window shows. Raises FileNotFoundError where there is no Chromium."""
    from PIL import Image  # comes with matplotlib

    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        raise FileNotFoundError("no Chromium in PATH: install one")
    scheme, url = ("dark" if look == "dark" else "light"), page.printed if look == "print" else page.url
    width = page.wide if look == "print" else width
    frame, picture = folder / "frame.html", folder / "picture.png"
    paper = "#14181c" if scheme == "dark" else "#fff"
    frame.write_text(FRAME.format(scheme=scheme, paper=paper, url=url, width=width, height=HEIGHT), encoding="utf-8")
    options = [
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        f"--window-size={width},{HEIGHT + 200}",
    ]
    options += [f"--user-data-dir={folder / 'profile'}", f"--timeout={WAIT}", f"--screenshot={picture}"]
    subprocess.run([browser, *options, frame.as_uri()], check=True, capture_output=True, timeout=120)
    with Image.open(picture) as taken:
        return taken.convert("RGB").crop((0, 0, width, HEIGHT))


def compose(pictures: "list[Image]", target: Path) -> None:
    """The pictures side by side, smaller, with a palette."""
    from PIL import Image

    small = [
        one.resize((round(SCALE * one.width), round(SCALE * one.height)), Image.Resampling.LANCZOS) for one in pictures
    ]
    sheet = Image.new(
        "RGB", (sum(one.width for one in small) + GAP * (len(small) + 1), small[0].height + 2 * GAP), "#9aa4ae"
    )
    left = GAP
    for one in small:
        sheet.paste(one, (left, GAP))
        left += one.width + GAP
    sheet.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(target, optimize=True)


if __name__ == "__main__":
    main()
