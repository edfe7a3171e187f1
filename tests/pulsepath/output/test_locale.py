"""A locale with decimal commas changes no byte of any file, and nothing that is read or planned."""

import locale
import os
import re
import shutil
import subprocess

import numpy as np
import pytest

from kinematics import load_machine
from planner import Line, Program, Synchronised, load_program, plan
from planner.export import motion_file
from planner.export.format import FORMATS, ExportSource, find_format
from tests import read_lines

COMMAS = ("de_DE.UTF-8", "fr_FR.UTF-8", "nl_NL.UTF-8", "de_DE", "German_Germany.1252")
MACHINES = {
    "kmitl-arms": "tripod",
    "kmitl-positions": "tripod",
    "byte": "tripod",
    "sasidhar": "traverser",
    "sahbaz": "sahbaz",
}
"""Formats of one machine, or of one kind of motion; the others are written for the hexapod's
circle.
"""


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Where a locale with commas was made by localedef, for systems that have the sources only."""
    folder = tmp_path_factory.mktemp("locales")
    if shutil.which("localedef") is not None:
        subprocess.run(
            ["localedef", "-i", "de_DE", "-f", "UTF-8", folder / COMMAS[0]],
            check=False,
            capture_output=True,
        )
    return str(folder)


@pytest.fixture
def commas(compiled, monkeypatch):
    """Calls what it is given under a locale with decimal commas."""

    def under(work):
        before = locale.setlocale(locale.LC_ALL)
        try:
            for path, name in [(os.environ.get("LOCPATH"), name) for name in COMMAS] + [
                (compiled, COMMAS[0])
            ]:
                monkeypatch.setenv("LOCPATH", path) if path else monkeypatch.delenv(
                    "LOCPATH", raising=False
                )
                try:
                    locale.setlocale(locale.LC_ALL, name)
                except locale.Error:
                    continue
                assert f"{1.5:n}" == "1,5"  # C itself now writes commas
                return work()
            pytest.skip(
                f"no locale with decimal commas: none of {', '.join(COMMAS)}, and localedef makes none"
            )
        finally:
            locale.setlocale(locale.LC_ALL, before)

    return under


@pytest.fixture(scope="module")
def sources(job):
    """By the name of a machine: the shared plan, and a short line of the two others; trapezoids for
    sahbaz.
    """
    made = {"hexapod": job.plan}
    for name, end in (("tripod", [0.0012, 0, 0.0005]), ("traverser", [0.002, 0.001, 0])):
        made[name] = plan(Program((Line(end),)), load_machine(name))
    made["sahbaz"] = plan(
        Program((Synchronised([0.002, 0.001, 0.01]),)), load_machine("hexapod"), order=2
    )
    return {
        name: ExportSource('a "1,5" ä', each.machine, each.trajectory, each.pulses)
        for name, each in made.items()
    }


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_writes_the_same_bytes(sources, commas, tmp_path, name):
    format_, source = find_format(name)(), sources[MACHINES.get(name, "hexapod")]
    usual = format_.write(source, tmp_path / "usual")
    with_commas = commas(lambda: format_.write(source, tmp_path / "commas"))
    assert (tmp_path / "commas").read_bytes() == (tmp_path / "usual").read_bytes()
    assert with_commas == usual


def test_so_do_the_files_of_a_plan(directory, job, write_plan, commas, tmp_path, monkeypatch):
    """All but the report, which is for eyes."""
    monkeypatch.setattr("benchmarks.reports.plan_report.write_report", lambda *_, **__: None)
    commas(lambda: write_plan(job, tmp_path))
    names = {path.name for path in tmp_path.iterdir()}
    assert names >= {"plan.json", "certificate.json", "motion.bin", "trajectory.csv", "pulses.bin"}
    for name in names:
        written, usual = (
            _but_the_report((folder / name).read_bytes()) for folder in (tmp_path, directory)
        )
        assert written == usual, name


def _but_the_report(content):
    """Without the lines of plan.json that depend on the report: digests of its page and figures,
    and the record's.
    """
    return re.sub(
        rb'(?m)^ +"(report\.html|figures/[^"]+|record)": "[0-9a-f]{64}",?\n', b"", content
    )


def test_what_is_read_and_planned_is_the_same(edges, job, commas):
    machine, pulses = job.plan.machine, job.plan.pulses

    def read():
        held = read_lines.read(
            edges / "pulses.csv", pulses.clock_hz, machine.axes, machine.home_q
        ).schedule
        motion = motion_file.read_motion(edges / "motion.bin", job.plan.path)
        made = plan(load_program("bare-circle"), load_machine("hexapod"), order=2)
        return held, motion, made

    held, motion, made = commas(read)
    assert all(
        np.array_equal(got.ticks, axis.ticks)
        for got, axis in zip(held.axes, pulses.axes, strict=True)
    )
    assert np.array_equal(motion.knots, job.plan.trajectory.knots)
    again = plan(load_program("bare-circle"), load_machine("hexapod"), order=2)
    assert np.array_equal(made.trajectory.knots, again.trajectory.knots)
