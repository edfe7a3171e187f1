"""Progress goes to stderr."""

import click
import numpy as np

from pulsepath import progress
from pulsepath.progress import step


def test_a_step_is_one_line_on_stderr_and_with_v_its_duration_another(capsys):
    with step("counting"):
        assert capsys.readouterr() == ("", "counting …\n")
    assert capsys.readouterr() == ("", "")
    with click.Context(click.Command("count")) as context:
        context.meta["pulsepath.progress"] = progress.VERBOSE
        with step("counting"):
            assert capsys.readouterr() == ("", "counting …\n")
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("counting: ")
    assert err.endswith(" s\n")


def test_a_long_step_tells_how_far_it_is(capsys, monkeypatch):
    with step("counting") as tell:
        tell(1, 3)  # too early to say anything
        monkeypatch.setattr(progress, "REPORT_PERIOD", 0.0)
        tell(2, 3)
    assert capsys.readouterr().err.splitlines()[:2] == ["counting …", "counting: 2 of 3"]


def test_lines_come_soon_and_then_more_rarely(capsys, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(progress, "perf_counter", lambda: now[0])
    with step("counting") as tell:
        for second in range(60):
            now[0] = second + 0.5
            tell(second, 60)
    told = [int(line.split()[1]) for line in capsys.readouterr().err.splitlines()[1:]]
    assert told[:4] == [2, 7, 16, 27]  # after 2, 4, 8 and then every 10 s, to the second after
    assert set(np.diff(told[3:])) == {11}


def test_of_many_the_share_is_told(capsys, monkeypatch):
    monkeypatch.setattr(progress, "REPORT_PERIOD", 0.0)
    with step("reading") as tell:
        tell(1_999_999, 10_000_000)
        tell(10_000_000, 10_000_000)
    assert capsys.readouterr().err.splitlines()[1:3] == ["reading: 19 %", "reading: 100 %"]
