"""Options made from requests, and requests made from options."""

import click
import pytest
from click.testing import CliRunner

from planner.request import PlanRequest, find_options
from pulsepath.cli import main
from pulsepath.request_options import find_flag, list_options, read_request, request_options
from pulsepath.requests import InputRequest, ReportRequest

KINDS = (PlanRequest, ReportRequest)


def parse(*words):
    """Return the options and the requests of a command line."""
    read = []

    @click.command()
    @request_options(*KINDS)
    def command(**options):
        read.append((options, [read_request(kind, options) for kind in KINDS]))

    result = CliRunner().invoke(command, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return read[0]


def test_plan_and_check_offer_an_option_for_each_field():
    for name, kinds in {"plan": (InputRequest, *KINDS), "check": (InputRequest,)}.items():
        command = main.commands[name]
        flags = {flag for parameter in command.params for flag in parameter.opts}
        wanted = {find_flag(field) for kind in kinds for field in find_options(kind)}
        assert wanted <= flags
        assert len(wanted) >= 2


@pytest.mark.parametrize(
    ("words", "missing"),
    [
        ("compare servo-rig", "--out"),
        ("calibrate hexapod cmm", "--out"),
        ("import part.dxf", "--out"),
        ("export plan", "--format"),
        ("console", "--machine"),
    ],
)
def test_an_option_without_a_default_is_required(call, words, missing):
    result = call(*words.split())
    assert result.exit_code == 2
    assert f"Missing option '{missing}'" in result.stderr


def test_without_options_a_request_has_its_defaults():
    _, requests = parse()
    assert requests == [PlanRequest(), ReportRequest()]


GIVEN = {
    "order": ("--order 2", PlanRequest(order=2)),
    "clock": ("--clock-hz 16MHz", PlanRequest(clock_hz=16_000_000)),
    "duration": ("--duration 1500ms", PlanRequest(duration=1.5)),
    "gap": ("--gap 0.5% --effort 0", PlanRequest(gap=0.005, effort=0)),
    "rule": (
        "--rule floor --objective time+heat",
        PlanRequest(rule="floor", objective="time+heat"),
    ),
    "no": (
        "--no-figures --no-worth --no-baselines --whole",
        ReportRequest(figures=False, worth=False, baselines=False, stream=False),
    ),
    "yes": (
        "--worth --baselines --stream --keep-certified --cross-check",
        ReportRequest(
            worth=True,
            baselines=True,
            stream=True,
            keep_certified=True,
            cross_check=True,
        ),
    ),
    "values": (
        "--bound full --pulses csv --stops 3 --rig servo-rig --cluster tcp://a:1",
        ReportRequest(bound="full", pulses="csv", stops=3, rig="servo-rig", cluster="tcp://a:1"),
    ),
}


@pytest.mark.parametrize(("words", "expected"), GIVEN.values(), ids=GIVEN)
def test_options_are_read_in_si_units_and_written_so_that_they_are_read_again(words, expected):
    options, requests = parse(*words.split())
    assert expected in requests
    written = list_options(options, *KINDS)
    again = []
    for name, value in written.items():
        again += [f"--{name}"] if value is True else [f"--{name}", str(value)]
    assert parse(*again)[1] == requests
    assert {"clock-hz", "rule", "objective", "pulses"} <= written.keys()


@pytest.mark.parametrize(
    ("effort", "request_"),
    [
        ("auto", ReportRequest()),
        ("full", ReportRequest(worth=True)),
        ("none", ReportRequest(worth=False)),
        ("full", ReportRequest(worth=False, bound="full")),
    ],
)
def test_the_effort_on_the_bound_follows_from_worth_unless_it_is_given(effort, request_):
    assert request_.bound_effort == effort
