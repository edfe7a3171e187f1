"""Progress goes to stderr."""

from pulsepath.progress import step


def test_a_step_tells_what_and_how_long_on_stderr(capsys):
    with step("counting"):
        assert capsys.readouterr() == ("", "counting …\n")
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("counting: ")
    assert err.endswith(" s\n")
