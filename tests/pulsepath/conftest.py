"""One plan of the bare circle that the tests of the front door share, and a command line without a process."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest
from click.testing import CliRunner

from benchmarks.reports.page import Picture, draw_figure
from benchmarks.reports.time_series import read_panels
from kinematics import NotInstalled
from planner.request import PlanRequest
from pulsepath.cli import main
from pulsepath.inputs import read_inputs
from pulsepath.job import run
from pulsepath.process.exits import describe_error
from pulsepath.requests import ReportRequest

REPORTS = ("plan_report", "parts_report", "calibration_report", "gain.run_figures")
DOT = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108000000003a"
    "7e9b550000000a49444154789c63f80f0001010100b138f6140000000049"
    "454e44ae426082"
)
"""A PNG image of one dot."""


@contextmanager
def drawing(draw) -> Iterator[None]:
    """Within, figures of reports are drawn so."""
    with pytest.MonkeyPatch.context() as patch:
        for name in REPORTS:
            patch.setattr(f"benchmarks.reports.{name}.draw_figure", draw)
        yield


@pytest.fixture(scope="module", autouse=True)
def undrawn():
    """Figures of reports are a dot, which nobody looks at here; what a page draws anew from data is as it is.

    Drawing them takes nine tenths of writing a plan. Who compares or looks at figures asks for `drawn`.
    """
    with drawing(lambda *axes, small=False: Picture(DOT, read_panels(axes))):
        yield


@pytest.fixture
def drawn():
    """Figures of reports as users have them."""
    with drawing(draw_figure):
        yield


@pytest.fixture(scope="session")
def inputs():
    return read_inputs("bare-circle", None)


@pytest.fixture(scope="session")
def job(inputs):
    return run(inputs.program, inputs.machine, PlanRequest(), ReportRequest(bound="full", baselines=True))


@pytest.fixture(autouse=True)
def absent_packages_skip(monkeypatch):
    """A command without a process that asks for a package which is not there skips its test, as the library does."""

    def telling(error):
        if isinstance(error, NotInstalled):
            pytest.skip(str(error))
        return describe_error(error)

    monkeypatch.setattr("pulsepath.command_group.describe_error", telling)


@pytest.fixture(scope="session")
def call():
    """Calls the command line; the result has .exit_code, .stdout and .stderr."""
    return lambda *arguments: CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture
def planned(monkeypatch, job):
    """Lets `plan` take the shared plan instead of making its own: for tests of what is done with it."""
    monkeypatch.setattr("pulsepath.job.run", lambda *_: job)


@pytest.fixture(scope="session")
def directory(tmp_path_factory, inputs, job):
    """What `plan` writes for the shared plan; not to be changed."""
    from pulsepath.output import plan_directory

    folder = tmp_path_factory.mktemp("plans") / "bare-circle"
    folder.mkdir()
    with drawing(draw_figure):
        plan_directory.write(folder, job, inputs)
    return folder


@pytest.fixture(scope="session")
def edges(tmp_path_factory, inputs, job):
    """The same with its pulses as edges, and without figures; not to be changed."""
    from pulsepath.output import plan_directory

    folder = tmp_path_factory.mktemp("edges") / "bare-circle"
    folder.mkdir()
    plan_directory.write(folder, replace(job, figures=False), inputs, "csv")
    return folder


@pytest.fixture
def plan(tmp_path, directory):
    """A copy of the shared plan, to change: of its files only what later commands read."""
    folder = tmp_path / "plan"
    folder.mkdir()
    for name in ("plan.json", "motion.bin", "program.toml", "machine.toml"):
        (folder / name).write_bytes((directory / name).read_bytes())
    return folder
