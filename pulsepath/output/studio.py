"""The pages of `pulsepath studio`: the list of plans, their reports, and the state of replanning."""

import subprocess
import sys
import tomllib
from collections.abc import Iterable, Sequence
from hashlib import sha256
from pathlib import Path
from threading import Event, Thread
from types import TracebackType
from typing import Self

from benchmarks.reports.page import render
from pulsepath.output.plan_list import Listed, PlanList, find_folder_name, read_below
from pulsepath.page_server import DATA, PAGE, REPORT_PATH, Query
from pulsepath.process.ending import on_forced_end

SAVED_PERIOD = 0.3
"""s between two looks whether a file was saved."""
END_TIME = 5.0
"""s that a plan in progress may take to end when it is asked to."""


class Replanner:
    """Plans a program's file, and again whenever that or its machine's file is saved; in a process of its own."""

    def __init__(self, program: Path, machine: str | None, options: Sequence[str], folder: Path) -> None:
        """folder: the plan goes into one of the program's name below it."""
        self.state, self.refused = "", False
        target = folder / program.stem
        self._command = [sys.executable, "-m", "pulsepath", "-q", "plan", str(program), "--out", str(target), "--force"]
        self._command += [*(() if machine is None else ("--machine", machine)), *options]
        self._program, self._machine = program, machine
        self._ended = Event()
        self._thread = Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        files: list[Path] = []
        stamps: list[tuple[int, int] | None] | None = None
        while not self._ended.wait(0.0 if stamps is None else SAVED_PERIOD):
            if stamps is None or [_stamp(file) for file in files] != stamps:
                files = [self._program, *_list_machine(self._program, self._machine)]
                stamps = [_stamp(file) for file in files]
                self._plan()

    def _plan(self) -> None:
        self.state, self.refused = f"planning {self._program.name} …", False
        with (
            subprocess.Popen(
                self._command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, encoding="utf-8", errors="replace"
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
    """The machine's file: as it is given, or as the program names it, from its own folder; a preset has none here."""
    if machine is not None:
        return [Path(machine)]
    try:
        named = tomllib.loads(program.read_text(encoding="utf-8")).get("machine")
    except (OSError, ValueError):  # just being saved, or no TOML: planning says what is wrong
        return []
    return [program.parent / named] if isinstance(named, str) else []


def _stamp(file: Path) -> tuple[int, int] | None:
    try:
        stamps = file.stat()
    except OSError:  # a preset, or just being saved
        return None
    return stamps.st_mtime_ns, stamps.st_size


class Studio:
    """Answers requests of a browser: / with ?show=NAME of a plan, /compare?left=NAME&right=NAME of two,
    /report?of=NAME, /stamp.
    """

    def __init__(self, folder: Path, replanner: Replanner | None = None) -> None:
        self._folder, self._plans, self._replanner = folder, PlanList(folder), replanner

    def answer(self, path: str, query: Query) -> tuple[str, bytes] | None:
        """Return the type and content of a page. None: there is no such page."""
        listed = self._plans.find()
        if path == "/":
            return PAGE, self._draw(listed, query.get("show", ())[:1]).encode()
        if path == "/compare":
            return PAGE, self._draw(listed, [*query.get("left", ())[:1], *query.get("right", ())[:1]]).encode()
        if path == "/stamp":
            return DATA, f'"{self._digest(listed)}"'.encode()
        if path == REPORT_PATH:
            names = query.get("of", ())
            for one in listed:  # nothing but what is listed can be asked for
                if [one.name] == list(names):
                    try:
                        return PAGE, read_below(self._folder, one.report)
                    except OSError:
                        return None
        return None

    @property
    def _state(self) -> tuple[str, bool]:
        return ("", False) if self._replanner is None else (self._replanner.state, self._replanner.refused)

    def _digest(self, listed: Iterable[Listed]) -> str:
        """Another one whenever the page looks different."""
        return sha256(repr([*((one.name, one.stamp) for one in listed), self._state]).encode()).hexdigest()

    def _draw(self, listed: Sequence[Listed], names: Sequence[str]) -> str:
        known = {one.name: one for one in listed}
        requested = list(dict.fromkeys(names))
        shown = [known[name] for name in requested if name in known]
        if not names and len(listed) == 1:
            shown = list(listed)
        state, refused = self._state
        both = len(shown) == 2 and all(one.figures for one in shown)
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
SAME_SHARE = 1e-5
"""Uses of a limit that differ by less are alike: the rest is how a solver ends."""


def list_differences(first: Listed, second: Listed) -> list[tuple[str, str, str, str]]:
    """Return rows of label, both values, and the difference, for each figure that either plan states."""
    rows: list[tuple[str, str, str, str]] = []
    for label in dict.fromkeys((*first.facts, *second.facts)):
        one, other = (each.facts.get(label, "–") for each in (first, second))
        rows.append((label, one, other, "" if one == other else "differs"))
    for key in dict.fromkeys((*first.figures, *second.figures)):
        before, after = first.figures.get(key), second.figures.get(key)
        if before is None and after is None:
            continue
        label, scale, unit = _name_figure(key)
        alike = unit == "%" and abs((after or 0.0) - (before or 0.0)) < SAME_SHARE
        changed = "" if alike else _tell_change(before, after, scale, unit)
        rows.append((label, _tell(before, scale, unit), _tell(after, scale, unit), changed))
    return rows


def _name_figure(key: str) -> tuple[str, float, str]:
    """Return the label of a figure, and the factor and name of its unit for people."""
    if key.startswith(SHARES):
        return key, 100.0, "%"
    return (key, 1e6, "µm") if key.startswith(ERRORS) else UNITS.get(key, (key, 1.0, ""))


def _tell(value: float | None, scale: float, unit: str) -> str:
    if value is None:
        return "–"
    if not unit and value == int(value):  # a count
        return f"{int(value)}"
    return f"{value * scale:.{4 if unit == '%' else 7}g} {unit}".rstrip()


def _tell_change(before: float | None, after: float | None, scale: float, unit: str) -> str:
    if before is None or after is None:
        return "in one of them only"
    change = (after - before) * scale
    share = "" if unit == "%" or not before or not change else f" ({100 * (after - before) / before:+.3g} %)"
    message = f"{int(change):+d}" if not unit and change == int(change) else f"{change:+.4g} {unit}".rstrip()
    return message + share if change else ""
