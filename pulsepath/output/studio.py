"""The pages of `pulsepath studio`: the list of plans, their reports, and replanning."""

import subprocess
import sys
import tomllib
from collections.abc import Iterable, Sequence
from hashlib import sha256
from os.path import realpath
from pathlib import Path
from threading import Event, Thread
from types import TracebackType
from typing import Self

from benchmarks.reports.page import render
from kinematics.files.atomic_files import Stamp, stamp
from pulsepath.output.plan_list import Listed, PlanList, find_folder_name, read_below
from pulsepath.page_server import DATA, PAGE, REPORT_PATH, Query
from pulsepath.process.ending import on_forced_end

# s between two checks whether a file was saved.
SAVED_PERIOD = 0.3
# s that a plan in progress may take to end after a signal.
END_TIME = 5.0


class Replanner:
    """Plans a program in another process, again whenever its file or the machine's is saved."""

    def __init__(
        self,
        program: Path,
        machine: str | None,
        options: Sequence[str],
        folder: Path,
    ) -> None:
        """folder: where the folder of the plan is, which has the program's name"""
        self.state = ""
        self.refused = False
        machine_options = () if machine is None else ("--machine", machine)
        self._command = [
            *(sys.executable, "-m", "pulsepath", "-q", "plan", str(program)),
            *("--out", str(folder / program.stem), "--force"),
            *machine_options,
            *options,
        ]
        self._program = program
        self._machine = machine
        self._ended = Event()
        self._thread = Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        files: list[Path] = []
        stamps: list[Stamp] | None = None
        while not self._ended.wait(0.0 if stamps is None else SAVED_PERIOD):
            if stamps is None or _stamp(files) != stamps:
                # A long program is parsed only when it has changed.
                files = [self._program, *_list_machine(self._program, self._machine)]
                stamps = _stamp(files)
                self._plan()

    def _plan(self) -> None:
        self.state, self.refused = f"planning {self._program.name} …", False
        with (
            subprocess.Popen(
                self._command,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
            ) as process,
            on_forced_end(process.kill),
        ):
            while True:
                try:
                    _, text_of_errors = process.communicate(timeout=SAVED_PERIOD)
                    break
                except subprocess.TimeoutExpired:
                    if self._ended.is_set():
                        _end(process)
                        return
        self.refused = process.returncode != 0
        self.state = text_of_errors.strip() if self.refused else ""


def _end(process: "subprocess.Popen[str]") -> None:
    process.terminate()
    try:
        process.communicate(timeout=END_TIME)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()


def _list_machine(program: Path, machine: str | None) -> list[Path]:
    """Return the machine's file: given, or named by the program. A preset has none."""
    if machine is not None:
        return [Path(machine)]
    try:
        named = tomllib.loads(program.read_text(encoding="utf-8")).get("machine")
    except (OSError, ValueError):  # being saved, or no TOML, which planning reports
        return []
    return [program.parent / named] if isinstance(named, str) else []


def _stamp(files: Iterable[Path]) -> list[Stamp]:
    """Return what changes when files are saved. Links are followed, unlike by `stamp`."""
    return [stamp(Path(realpath(file))) for file in files]


class Studio:
    """Answers requests of a browser.

    /                    the page, with ?show=NAME of a plan
    /compare             the page with two plans, ?left=NAME&right=NAME
    /report?of=NAME      the report of a plan
    /stamp               a text that changes with the page
    """

    def __init__(self, folder: Path, replanner: Replanner | None = None) -> None:
        self._folder = folder
        self._plans = PlanList(folder)
        self._replanner = replanner

    def answer(self, path: str, query: Query) -> tuple[str, bytes] | None:
        """Return the type and content of a page. None: there is no such page."""
        listed = self._plans.find()
        if path == "/":
            return PAGE, self._draw(listed, query.get("show", ())[:1]).encode()
        if path == "/compare":
            names = [*query.get("left", ())[:1], *query.get("right", ())[:1]]
            return PAGE, self._draw(listed, names).encode()
        if path == "/stamp":
            return DATA, f'"{self._digest(listed)}"'.encode()
        if path != REPORT_PATH:
            return None
        # Only reports of listed plans can be read.
        for plan in listed:
            if [plan.name] == list(query.get("of", ())):
                try:
                    return PAGE, read_below(self._folder, plan.report)
                except OSError:
                    return None
        return None

    @property
    def _state(self) -> tuple[str, bool]:
        if self._replanner is None:
            return "", False
        return self._replanner.state, self._replanner.refused

    def _digest(self, listed: Iterable[Listed]) -> str:
        """Return a text that differs whenever the page looks different."""
        stamps = [*((plan.name, plan.stamp) for plan in listed), self._state]
        return sha256(repr(stamps).encode()).hexdigest()

    def _draw(self, listed: Sequence[Listed], names: Sequence[str]) -> str:
        known = {plan.name: plan for plan in listed}
        requested = list(dict.fromkeys(names))
        shown = [known[name] for name in requested if name in known]
        if not names and len(listed) == 1:
            shown = list(listed)
        state, refused = self._state
        both = len(shown) == 2 and all(plan.figures for plan in shown)
        return render(
            "studio.html.j2",
            {},
            folder=find_folder_name(self._folder),
            place=str(self._folder.resolve()),
            proposed=str(self._folder / "circle"),
            listed=listed,
            shown=shown,
            missing=[name for name in requested if name not in known],
            differences=list_differences(*shown) if both else [],
            state=state,
            refused=refused,
            stamp=self._digest(listed),
        )


# Label of a figure, and the factor and name of its unit for people.
UNITS = {
    "duration_s": ("duration", 1.0, "s"),
    "before_shapers_s": ("duration before the shapers", 1.0, "s"),
    "cost_of_shapers_s": ("cost of the shapers", 1e3, "ms"),
    "lower_bound_s": ("lower bound", 1.0, "s"),
    "baseline_s": ("baseline", 1.0, "s"),
    "path_length_m": ("path length", 1e3, "mm"),
    "highest_rate_hz": ("highest pulse rate", 1e-3, "kHz"),
    "drive_margin": ("drive timing, least of kept / needed", 1.0, "×"),
    "quantization_m": ("largest quantization error", 1e6, "µm"),
}
SHARES = ("gap", "use of ")
ERRORS = "contour error"
# Difference of two uses of a limit below which they are equal: it is how a solver ends.
SAME_SHARE = 1e-5


def list_differences(first: Listed, second: Listed) -> list[tuple[str, str, str, str]]:
    """Return a row of label, both values and the difference for each figure of either plan."""
    rows: list[tuple[str, str, str, str]] = []
    for label in dict.fromkeys((*first.facts, *second.facts)):
        left, right = (plan.facts.get(label, "–") for plan in (first, second))
        rows.append((label, left, right, "" if left == right else "differs"))
    for key in dict.fromkeys((*first.figures, *second.figures)):
        before, after = first.figures.get(key), second.figures.get(key)
        if before is None and after is None:
            continue
        label, scale, unit = _name_figure(key)
        left, right = (_format(value, scale, unit) for value in (before, after))
        rows.append((label, left, right, _format_change(before, after, scale, unit)))
    return rows


def _name_figure(key: str) -> tuple[str, float, str]:
    """Return the label of a figure, and the factor and name of its unit."""
    if key.startswith(SHARES):
        return key, 100.0, "%"
    if key.startswith(ERRORS):
        return key, 1e6, "µm"
    return UNITS.get(key, (key, 1.0, ""))


def _format(value: float | None, scale: float, unit: str) -> str:
    if value is None:
        return "–"
    if not unit and value == int(value):  # a count
        return f"{int(value)}"
    digits = 4 if unit == "%" else 7
    return f"{value * scale:.{digits}g} {unit}".rstrip()


def _format_change(before: float | None, after: float | None, scale: float, unit: str) -> str:
    """Return the difference of two values, and its share of the first. "": none"""
    is_share = unit == "%"
    if is_share and abs((after or 0.0) - (before or 0.0)) < SAME_SHARE:
        return ""
    if before is None or after is None:
        return "in one of them only"
    change = (after - before) * scale
    if not change:
        return ""
    is_count = not unit and change == int(change)
    text = f"{int(change):+d}" if is_count else f"{change:+.4g} {unit}".rstrip()
    if before and not is_share:
        text += f" ({100 * (after - before) / before:+.3g} %)"
    return text
