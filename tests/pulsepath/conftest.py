"""One plan of the bare circle that the tests of the front door share, and a command line without a
process.
"""

from dataclasses import replace

import pytest
from click.testing import CliRunner

from benchmarks.reports.page import draw_figure
from kinematics import NotInstalled
from planner.request import PlanRequest
from pulsepath.cli import main
from pulsepath.inputs import read_inputs
from pulsepath.job import run
from pulsepath.process.exits import describe_error
from pulsepath.requests import ReportRequest
from tests.drawing import draw_dots, drawing


@pytest.fixture(scope="module", autouse=True)
def undrawn():
    """Figures of reports are a dot, which nobody looks at here; what a page draws anew from data is
    as it is.

    Drawing them takes nine tenths of writing a plan. Who compares or looks at figures asks for
    `drawn`.
    """
    with draw_dots():
        yield


@pytest.fixture(scope="session", autouse=True)
def few_pulses_compared():
    """Commands compare the path that pulses make with the planned one at every so-manieth pulse, of
    which there are few here.

    It takes a third of a plan by a command, and what comes of more has tests of its own, in
    tests/planner/pulses.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pulsepath.job.REALISED_SAMPLES", 500)
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
    return run(
        inputs.program, inputs.machine, PlanRequest(), ReportRequest(bound="full", baselines=True)
    )


@pytest.fixture(autouse=True)
def absent_packages_skip(monkeypatch):
    """A command without a process that asks for a package which is not there skips its test, as the
    library does.
    """

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
    """Lets `plan` take the shared plan instead of making its own: for tests of what is done with
    it.
    """
    monkeypatch.setattr("pulsepath.job.run", lambda *_: job)


@pytest.fixture(scope="session")
def write_plan(call):
    """(plan that is made already, folder, *options) -> the folder, as the command `plan` writes
    it.
    """

    def write(job, folder, *options):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("pulsepath.job.run", lambda *_: job)
            done = call("plan", "bare-circle", *options, "--out", folder)
        assert done.exit_code == 0, done.stderr
        return folder

    return write


@pytest.fixture(scope="session")
def directory(tmp_path_factory, write_plan, job):
    """What `plan` writes for the shared plan; not to be changed."""
    with draw_dots():
        return write_plan(job, tmp_path_factory.mktemp("plans") / "bare-circle")


@pytest.fixture(scope="session")
def edges(tmp_path_factory, write_plan, job):
    """The same with its pulses as edges, and without figures; not to be changed."""
    return write_plan(
        replace(job, draw=None), tmp_path_factory.mktemp("edges") / "bare-circle", "--pulses", "csv"
    )


@pytest.fixture(scope="session")
def corner(tmp_path_factory, call):
    """A plan of two lines on three axes, which is held and drawn much sooner; not to be changed."""
    folder = tmp_path_factory.mktemp("corner")
    program = folder / "corner.nc"
    program.write_text("G21 G90 F1200\nG1 X5 Y5\nX10 Y0\n", encoding="utf-8")
    asked = (
        "plan",
        program,
        "--machine",
        "corexy",
        "--order",
        "2",
        "--no-figures",
        "--no-baselines",
        "--no-worth",
    )
    done = call(*asked, "--whole", "--out", folder / "plan")
    assert done.exit_code == 0, done.stderr
    return folder / "plan"


@pytest.fixture
def plan(tmp_path, directory):
    """A copy of the shared plan, to change: of its files only what later commands read."""
    folder = tmp_path / "plan"
    folder.mkdir()
    for name in ("plan.json", "motion.bin", "program.toml", "machine.toml"):
        (folder / name).write_bytes((directory / name).read_bytes())
    return folder
